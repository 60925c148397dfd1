// Sub-pixel alignment: random homographies between two pictures, with right and wrong matches.
#include <Eigen/Geometry>
#include <cmath>

#include "input.h"
#include "one_instruction_set.h"

namespace ktgp_orb::fuzz {
namespace {

using util::Random;

std::vector<Correspondence> matches(Input& in, const Features& reference, const Features& target) {
  std::vector<Correspondence> all;
  if (reference.empty() || target.empty()) return all;
  Random random(in.ConsumeIntegral<std::uint16_t>());
  const int count = few(in, 300);
  const bool wrong = in.ConsumeIntegralInRange(0, 31) == 0;
  for (int i = 0; i < count; ++i) {
    all.push_back({static_cast<std::int32_t>(random.below(static_cast<unsigned>(reference.size()))),
                   static_cast<std::int32_t>(random.below(static_cast<unsigned>(target.size()))),
                   10, 20, Level::ktgp, false});
  }
  if (wrong && !all.empty()) all.back().target_index = in.ConsumeIntegral<std::int32_t>();
  return all;
}

/// A picture with random keypoints; those of a message may be outside, too.
Features frame(Input& in) {
  Features out = features(in, 150);
  out.image_size = {in.ConsumeIntegralInRange(24, 100), in.ConsumeIntegralInRange(24, 100)};
  if (in.ConsumeIntegralInRange(0, 63) == 0) out.image_size.width = 1;
  out.images = pyramid(in, out.image_size);
  for (cv::KeyPoint& keypoint : out.keypoints) {
    const cv::Point2f& p = keypoint.pt;
    if (!(p.x < 2000.0F && p.y < 2000.0F)) continue;
    keypoint.pt = {std::fmod(p.x, static_cast<float>(out.image_size.width)),
                   std::fmod(p.y, static_cast<float>(out.image_size.height))};
  }
  return out;
}

/// The same frame, with its keypoints mapped by the homography.
Features moved(const Features& reference, const Eigen::Matrix3d& h) {
  Features target = reference;
  for (cv::KeyPoint& keypoint : target.keypoints) {
    const Eigen::Vector2d p =
        (h * Eigen::Vector3d(keypoint.pt.x, keypoint.pt.y, 1.0)).hnormalized();
    keypoint.pt = {static_cast<float>(p.x()), static_cast<float>(p.y())};
  }
  return target;
}

void run(Input& in) {
  AlignmentOptions options;
  options.points = in.ConsumeIntegralInRange(12, 300);
  const Features reference = frame(in);
  const Eigen::Matrix3d h = homography(in, 20.0, 0.3, 2e-3);
  Features target = in.ConsumeBool() ? moved(reference, h) : frame(in);
  if (in.ConsumeIntegralInRange(0, 63) == 0) target.images.clear();
  const auto pairs = matches(in, reference, target);
  UncertainHomography start;
  start.homography = h;
  start.covariance = Covariance8::Identity();
  // Reused: the result must not depend on old content.
  static AlignmentResult result, again;
  Alignment alignment(options);
  alignment.align(reference, target, pairs, start, result);
  if (h.allFinite()) require(result.answer.homography.allFinite(), "H is finite");
  if (result.status != AlignmentStatus::ok && result.status != AlignmentStatus::not_run) {
    require(!h.allFinite() || result.answer.homography == h, "H is the given one unless ok");
  }
  require(result.tried <= static_cast<std::size_t>(options.points),
          "no more points than asked for");
  require(result.points.size() + result.outside + result.distorted + result.textureless +
                  result.unsettled + result.beyond_reach + result.uncorrelated ==
              result.tried,
          "each point is in exactly one count");
  for (const AlignedPoint& point : result.points) {
    require(point.match < pairs.size(), "points are of matches");
    require(point.target.allFinite() && point.correlation >= 0.5 && point.correlation <= 1.0 + 1e-9,
            "points are where the images agree");
  }
  const OneInstructionSet one(in);
  Alignment(options).align(reference, target, pairs, start, again);
  require(again.status == result.status && again.points.size() == result.points.size(),
          "the same answer with every instruction set");
  require(!h.allFinite() || again.answer.homography == result.answer.homography,
          "the same H with every instruction set");
}

}  // namespace
}  // namespace ktgp_orb::fuzz

KTGP_ORB_FUZZ(ktgp_orb::fuzz::run)  // an index outside its frame
