// Nearest neighbours, in the whole image and near predicted positions, in one and both directions,
// compared with a plain search.
#include <Eigen/LU>

#include <stdexcept>

#include "core/knn/near_search.h"
#include "core/knn/search.h"
#include "input.h"
#include "instruction_sets.h"

namespace ktgp_orb::fuzz {
namespace {

using knn::bestKnnKernel;
using knn::bestNearKernel;
using knn::KnnSearch;
using knn::NearSearch;
using knn::portableKnnKernel;
using knn::portableNearKernel;
using util::ThreadPool;

int hamming(const std::uint8_t* a, const std::uint8_t* b) {
  int distance = 0;
  for (int i = 0; i < kDescriptorBytes; i += 8) {
    std::uint64_t x = 0, y = 0;
    std::memcpy(&x, a + i, sizeof(x));
    std::memcpy(&y, b + i, sizeof(y));
    distance += __builtin_popcountll(x ^ y);
  }
  return distance;
}

/// `isAllowed(r, t)`: whether reference r may match target t.
template <typename IsAllowed>
std::vector<Correspondence> plain(const Features& reference, const Features& target,
                                  const IsAllowed& isAllowed) {
  constexpr int kNone = 1000;
  std::vector<Correspondence> found;
  std::vector<int> best(reference.size(), kNone);
  std::vector<int> nearest(reference.size(), -1);
  for (int t = 0; t < static_cast<int>(target.size()); ++t) {
    Correspondence c{-1, t, kNone, kNone, Level::knn, false};
    for (int r = 0; r < static_cast<int>(reference.size()); ++r) {
      if (!isAllowed(r, t)) continue;
      const int distance = hamming(reference.descriptors.ptr(r), target.descriptors.ptr(t));
      const auto of = static_cast<std::size_t>(r);
      if (distance < best[of]) {
        best[of] = distance;
        nearest[of] = t;
      }
      if (distance < c.distance) {
        c.second_distance = c.distance;
        c.distance = distance;
        c.reference_index = r;
      } else if (distance < c.second_distance) {
        c.second_distance = distance;
      }
    }
    found.push_back(c);
  }
  for (Correspondence& c : found) {
    if (c.reference_index < 0) continue;
    c.mutual = nearest[static_cast<std::size_t>(c.reference_index)] == c.target_index;
  }
  return found;
}

std::vector<Correspondence> plain(const Features& reference, const Features& target) {
  if (reference.empty()) return {};
  auto found = plain(reference, target, [](int, int) { return true; });
  for (Correspondence& c : found) {
    if (reference.size() == 1) c.second_distance = 0;
  }
  return found;
}

std::vector<Correspondence> plainNear(const Features& reference, const Features& target,
                                      const Eigen::Matrix3d& prediction, double radius) {
  if (reference.empty()) return {};
  Eigen::Matrix3d back = prediction.inverse();
  const Eigen::Vector3d middle(0.5 * target.image_size.width, 0.5 * target.image_size.height, 1.0);
  if (back.row(2).dot(middle) < 0.0) back = -back;  // the image is in front of the camera
  std::vector<cv::Point2f> places;
  for (const cv::KeyPoint& keypoint : target.keypoints) {
    const Eigen::Vector3d p = back * Eigen::Vector3d(keypoint.pt.x, keypoint.pt.y, 1.0);
    places.emplace_back(std::numeric_limits<float>::quiet_NaN(), 0.0F);
    if (!(p.z() > 0.0)) continue;
    places.back() = {static_cast<float>(p.x() / p.z()), static_cast<float>(p.y() / p.z())};
  }
  const auto squared_radius = static_cast<float>(radius) * static_cast<float>(radius);
  auto found = plain(reference, target, [&](int r, int t) {
    const cv::Point2f& p = reference.keypoints[static_cast<std::size_t>(r)].pt;
    const cv::Point2f& place = places[static_cast<std::size_t>(t)];
    const float dx = p.x - place.x;
    const float dy = p.y - place.y;
    const float xx = dx * dx;
    const float yy = dy * dy;
    return xx + yy <= squared_radius;
  });
  for (Correspondence& c : found) {
    if (c.reference_index < 0) c.distance = c.second_distance = 256;
    if (c.second_distance > 256) c.second_distance = std::max(c.distance, kUnrelatedDistance);
  }
  return found;
}

void requireEqual(const std::vector<Correspondence>& a, const std::vector<Correspondence>& b,
                  bool mutual) {
  require(a.size() == b.size(), "one for each target");
  for (std::size_t i = 0; i < a.size(); ++i) {
    require(a[i].reference_index == b[i].reference_index, "the nearest");
    require(a[i].target_index == b[i].target_index, "in target order");
    require(a[i].distance == b[i].distance, "its distance");
    require(a[i].second_distance == b[i].second_distance, "the second distance");
    require(!mutual || a[i].mutual == b[i].mutual, "mutual");
  }
}

template <typename Kernel>
const Kernel& any(Input& in, const std::vector<const Kernel*>& kernels) {
  return *kernels[in.ConsumeIntegralInRange<std::size_t>(0, kernels.size() - 1)];
}

void searchAll(Input& in, const Features& reference, const Features& target) {
  static const auto kernels = test::everyKernels(&bestKnnKernel, portableKnnKernel());
  const auto expected = plain(reference, target);
  std::vector<Correspondence> found;
  KnnSearch search(any(in, kernels), threads(in));
  search.match(reference.descriptors, target.descriptors, found);
  requireEqual(found, expected, false);
  search.matchMutual(reference.descriptors, target.descriptors, found);
  requireEqual(found, expected, true);
}

void searchNear(Input& in, const Features& reference, const Features& target) {
  static const auto kernels = test::everyKernels(&bestNearKernel, portableNearKernel());
  const bool any_radius = in.ConsumeIntegralInRange(0, 15) == 0;  // small ones make many cells
  const double radius = any_radius ? in.ConsumeFloatingPointInRange(0.01, 5000.0)
                                   : in.ConsumeFloatingPointInRange(20.0, 500.0);
  Eigen::Matrix3d prediction = Eigen::Matrix3d::Identity();
  for (int i = 0; i < 9; ++i) {
    const double unit = i % 3 == 2 && i < 8 ? 50.0 : (i < 6 ? 0.3 : 1e-3);
    prediction(i / 3, i % 3) += anyDouble(in, -unit, unit);
  }
  ThreadPool pool(threads(in));
  NearSearch search(any(in, kernels), radius, pool);
  std::vector<Correspondence> found;
  search.match(reference, target, prediction, true, found);
  requireEqual(found, plainNear(reference, target, prediction, radius), true);
}

void run(Input& in) {
  const Features reference = features(in, 200);
  const Features target = features(in, 150);
  if (in.ConsumeBool()) {
    searchAll(in, reference, target);
  } else {
    searchNear(in, reference, target);
  }
}

}  // namespace
}  // namespace ktgp_orb::fuzz

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* bytes, std::size_t size) {
  ktgp_orb::fuzz::Input in(bytes, size);
  try {
    ktgp_orb::fuzz::run(in);
  } catch (const std::invalid_argument&) {  // a prediction that cannot be inverted
  }
  return 0;
}
