#include "ktgp_orb/guided_matcher.h"

#include <cstdint>
#include <cstring>

#include "core/homography/checks.h"
#include "core/homography/refiner.h"
#include "core/util/cell_grid.h"
#include "core/util/keypoint_position.h"
#include "core/util/options_check.h"

namespace ktgp_orb {
namespace {

constexpr int kNoDistance = 256;

/// Bits set in each byte of `x`.
std::uint64_t byteCounts(std::uint64_t x) {
  x -= x >> 1 & 0x5555555555555555U;
  x = (x & 0x3333333333333333U) + (x >> 2 & 0x3333333333333333U);
  return (x + (x >> 4)) & 0x0f0f0f0f0f0f0f0fU;
}

/// Processors of the baseline have no instruction that counts bits; the four words share the last
/// steps.
int hammingDistance(const std::uint8_t* a, const std::uint8_t* b) {
  std::uint64_t sum = 0;
  for (int i = 0; i < kDescriptorBytes; i += 8) {
    std::uint64_t x = 0;
    std::uint64_t y = 0;
    std::memcpy(&x, a + i, 8);
    std::memcpy(&y, b + i, 8);
    sum += byteCounts(x ^ y);
  }
  const std::uint64_t pairs = (sum & 0x00ff00ff00ff00ffU) + (sum >> 8 & 0x00ff00ff00ff00ffU);
  return static_cast<int>(pairs * 0x0001000100010001U >> 48);
}

/// The nearest descriptor so far, and how near the next is.
struct Nearest {
  std::int32_t index = -1;
  std::int32_t distance = kNoDistance + 1;
  std::int32_t second = kNoDistance + 1;

  void offer(std::int32_t candidate, std::int32_t d) {
    const bool nearer = d < distance || (d == distance && candidate < index);
    if (nearer) {
      second = distance;
      distance = d;
      index = candidate;
    } else if (d < second) {
      second = d;
    }
  }
};

}  // namespace

struct GuidedMatcher::Impl {
  void findNearest(const Features& reference, const Features& target, const Eigen::Matrix3d& h);
  void offerNear(const Features& reference, std::int32_t index, const Features& target,
                 const Eigen::Vector2d& place);

  GuidedOptions options;
  std::size_t supporters(const Eigen::Matrix3d& homography, double threshold) const;
  bool estimate(const cv::Size& reference_size, double threshold, Eigen::Matrix3d& homography,
                Covariance8& covariance);

  CellGrid grid;
  std::vector<Nearest> of_reference;  // the nearest of the target
  std::vector<Nearest> of_target;     // the nearest of the reference
  HomographyRefiner refiner;
  std::vector<Correspondence> matches;
  std::vector<Eigen::Vector2d> reference_points;  // of these
  std::vector<Eigen::Vector2d> target_points;
  std::vector<std::uint8_t> taken;  // target keypoints that have their correspondence
};

GuidedMatcher::GuidedMatcher(const GuidedOptions& options) : impl_(std::make_unique<Impl>()) {
  requireInRange("guided_radius", options.radius, 0.1, 100.0);
  requireInRange("guided max_distance", options.max_distance, 0, kNoDistance);
  impl_->options = options;
}

GuidedMatcher::~GuidedMatcher() = default;
GuidedMatcher::GuidedMatcher(GuidedMatcher&&) noexcept = default;
GuidedMatcher& GuidedMatcher::operator=(GuidedMatcher&&) noexcept = default;

const GuidedOptions& GuidedMatcher::options() const {
  return impl_->options;
}

void GuidedMatcher::match(const Features& reference, const Features& target,
                          const Eigen::Matrix3d& homography, std::vector<Correspondence>& matches) {
  requireValid(reference, "reference");
  requireValid(target, "target");
  matches.clear();
  Impl& impl = *impl_;
  impl.findNearest(reference, target, homography);
  for (std::size_t t = 0; t < target.size(); ++t) {
    const Nearest& nearest = impl.of_target[t];
    if (nearest.index < 0 || nearest.distance > impl.options.max_distance) continue;
    const auto index = static_cast<std::int32_t>(t);
    if (impl.of_reference[static_cast<std::size_t>(nearest.index)].index != index) continue;
    matches.push_back({nearest.index, index, nearest.distance,
                       std::min(nearest.second, kNoDistance), Level::guided});
  }
}

void GuidedMatcher::Impl::findNearest(const Features& reference, const Features& target,
                                      const Eigen::Matrix3d& h) {
  of_reference.assign(reference.size(), Nearest());
  of_target.assign(target.size(), Nearest());
  if (target.empty()) return;
  grid.build(
      target.size(), [&](std::size_t i) { return target.keypoints[i].pt; }, target.image_size,
      options.radius);
  constexpr double kFar = 1e6;  // px
  for (std::size_t i = 0; i < reference.size(); ++i) {
    const Eigen::Vector2d x = position(reference, static_cast<std::int32_t>(i));
    const Eigen::Vector3d p = h * Eigen::Vector3d(x.x(), x.y(), 1.0);
    if (!(p.z() > 0.0)) continue;
    const Eigen::Vector2d place = p.head<2>() / p.z();
    // Written so that what is not finite is left out.
    if (place.cwiseAbs().maxCoeff() < kFar) {
      offerNear(reference, static_cast<std::int32_t>(i), target, place);
    }
  }
}

void GuidedMatcher::Impl::offerNear(const Features& reference, std::int32_t index,
                                    const Features& target, const Eigen::Vector2d& place) {
  const double radius2 = options.radius * options.radius;
  const std::uint8_t* descriptor = reference.descriptors.ptr(index);
  grid.visitNear(place.x(), place.y(), options.radius, [&](std::int32_t candidate) {
    if ((place - position(target, candidate)).squaredNorm() > radius2) return;
    const int distance = hammingDistance(descriptor, target.descriptors.ptr(candidate));
    of_reference[static_cast<std::size_t>(index)].offer(candidate, distance);
    of_target[static_cast<std::size_t>(candidate)].offer(index, distance);
  });
}

bool GuidedMatcher::refine(const Features& reference, const Features& target,
                           const std::vector<Correspondence>& correspondences, double threshold,
                           Eigen::Matrix3d& homography, Covariance8& covariance,
                           std::vector<Correspondence>& added) {
  Impl& impl = *impl_;
  match(reference, target, homography, impl.matches);
  impl.reference_points.clear();
  impl.target_points.clear();
  for (const Correspondence& c : impl.matches) {
    impl.reference_points.push_back(position(reference, c.reference_index));
    impl.target_points.push_back(position(target, c.target_index));
  }
  const bool better = impl.estimate(reference.image_size, threshold, homography, covariance);
  impl.taken.assign(target.size(), 0);
  for (const Correspondence& c : correspondences) {
    if (c.level >= Level::ktgp) impl.taken[static_cast<std::size_t>(c.target_index)] = 1;
  }
  added.clear();
  for (std::size_t i = 0; i < impl.matches.size(); ++i) {
    const Correspondence& c = impl.matches[i];
    const double error =
        reprojectionError(homography, impl.reference_points[i], impl.target_points[i]);
    if (error < threshold && impl.taken[static_cast<std::size_t>(c.target_index)] == 0) {
      added.push_back(c);
    }
  }
  return better;
}

bool GuidedMatcher::Impl::estimate(const cv::Size& reference_size, double threshold,
                                   Eigen::Matrix3d& homography, Covariance8& covariance) {
  Eigen::Matrix3d candidate = homography;
  Covariance8 candidate_covariance;
  RefinerOptions refinement;
  refinement.max_error = threshold;
  if (!refiner.refine(reference_points, target_points, refinement, candidate,
                      &candidate_covariance) ||
      !keepsPlaneInView(candidate, imageCorners(reference_size, reference_points)) ||
      supporters(candidate, threshold) < supporters(homography, threshold)) {
    return false;
  }
  homography = candidate;
  covariance = candidate_covariance;
  return true;
}

std::size_t GuidedMatcher::Impl::supporters(const Eigen::Matrix3d& homography,
                                            double threshold) const {
  std::size_t count = 0;
  for (std::size_t i = 0; i < matches.size(); ++i) {
    if (reprojectionError(homography, reference_points[i], target_points[i]) < threshold) ++count;
  }
  return count;
}

}  // namespace ktgp_orb
