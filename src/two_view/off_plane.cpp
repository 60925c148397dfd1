#include "two_view/off_plane.h"

#include "two_view/cameras.h"
#include "two_view/motions.h"

namespace ktgp_orb::two_view {

std::optional<OtherMotion> OffPlane::contradicting(
    const RelativePose& answer, const PointPairs& pairs, const std::vector<std::uint8_t>& on_plane,
    const std::vector<double>* deviations, const Cameras& cameras, const SharedShifts& shared,
    double max_error, double cell, double range) {
  constexpr std::size_t kFew = 20;  // minimum number of pairs off the plane
  // The motion of the pairs off the plane must explain them better than `answer` does by this
  // log-likelihood, and must explain kMost of them, but less than kOfPlane of the pairs on the
  // plane. Of 453 pairs of 23 rigid scenes, one is said to move, whose answer is 7 degrees off. In
  // the others with a lead above 6, the motion explains at least 0.77 of the plane, or less than
  // 0.5 of the pairs off the plane, which are mostly wrong matches.
  constexpr double kLead = 6.0;
  constexpr double kMost = 0.5;
  constexpr double kOfPlane = 0.7;
  points_.clear();
  deviations_.clear();
  for (std::size_t i = 0; i < pairs.size(); ++i) {
    if (on_plane[i] != 0) continue;
    points_.add(pairs.reference[i], pairs.target[i], pairs.quality[i]);
    deviations_.push_back(deviations == nullptr ? 1.0 : (*deviations)[i]);
  }
  if (points_.size() < kFew) return std::nullopt;
  order_.sort(points_.quality);
  pairs_.load(points_, order_, max_error, cameras, &deviations_);
  cell *= pairs_.scale();
  motions_.load(pairs_, cell, range * pairs_.scale(), pairs_.fromMotion(answer), nullptr);
  motions_.start(answer);
  motions_.start({turnOf(pairs_), answer.translation});
  motions_.refine();
  if (motions_.list().empty() || motions_.leadOver(answer) < kLead) return std::nullopt;

  Epipolar geometry = motions_.list().front().geometry;
  const Eigen::Matrix3d f = cameras.fundamentalOf(geometry.motion);
  double of[2] = {};         // number of pairs off the plane [0] and on it [1]
  double explained[2] = {};  // number of these pairs that agree with the motion
  for (std::size_t i = 0; i < pairs.size(); ++i) {
    const int part = on_plane[i] != 0 ? 1 : 0;
    of[part] += 1.0;
    const bool agrees = sampson(f, pairs.reference[i], pairs.target[i]) < max_error &&
                        cameras.seeInFront(geometry.motion, pairs.reference[i], pairs.target[i],
                                           max_error / kSampsonShare);
    explained[part] += agrees ? 1.0 : 0.0;
  }
  if (explained[0] < kMost * of[0] || explained[1] > kOfPlane * of[1]) return std::nullopt;
  fit_.setPairs(pairs_);
  if (!fit_.minimise(geometry)) return std::nullopt;
  const RelativePose& pose = geometry.motion;
  const EpipolarFit::SharedSteps steps = fit_.sharedSteps(geometry, shared.with(pose.rotation));
  const estimation::Information covariance =
      fit_.covariance(geometry, cell) + steps * steps.transpose();
  return OtherMotion{Geometry::epipolar, pose, poseCovariance(covariance, pose.translation)};
}

}  // namespace ktgp_orb::two_view
