#include "reference_keeper.h"

#include <Eigen/Geometry>
#include <cmath>
#include <opencv2/imgproc.hpp>
#include <vector>

namespace ktgp_orb {
namespace {

const ros::Time& stamp(const Frame& frame) {
  return frame.message->header.stamp;
}

Eigen::Matrix3d normalised(const Eigen::Matrix3d& h) {
  return std::abs(h(2, 2)) > 1e-12 * h.norm() ? Eigen::Matrix3d(h / h(2, 2)) : h;
}

}  // namespace

double overlap(const Eigen::Matrix3d& homography, const cv::Size& size) {
  const double w = size.width;
  const double h = size.height;
  const std::vector<cv::Point2f> image{
      {0.F, 0.F}, {float(w), 0.F}, {float(w), float(h)}, {0.F, float(h)}};
  std::vector<cv::Point2f> warped;
  for (const cv::Point2f& corner : image) {
    const Eigen::Vector3d p = homography * Eigen::Vector3d(corner.x, corner.y, 1.0);
    if (p.z() <= 0.0) return 0.0;  // a corner beyond the horizon
    warped.emplace_back(static_cast<float>(p.x() / p.z()), static_cast<float>(p.y() / p.z()));
  }
  std::vector<cv::Point2f> common;
  return cv::intersectConvexConvex(image, warped, common) / (w * h);
}

void ReferenceKeeper::setOptions(const ReferenceOptions& options) {
  if (options.mode != options_.mode) reset();
  options_ = options;
}

FramePtr ReferenceKeeper::referenceFor(const Frame& next) {
  if (options_.mode == ReferenceMode::fixed) return fixed_;
  if (!previous_) return nullptr;
  const double gap = (stamp(next) - stamp(*previous_)).toSec();
  const double age = (stamp(next) - stamp(*reference_)).toSec();
  // A keyframe may be old while frames keep coming; what must not be old is the last frame.
  const bool same_sequence = gap >= 0.0 && age >= 0.0 && gap <= options_.max_age &&
                             next.grey.size() == previous_->grey.size() &&
                             next.message->encoding == previous_->message->encoding;
  if (!same_sequence) reset();
  return reference_;
}

bool ReferenceKeeper::weak(const Frame& frame, const MatchResult& result) const {
  if (result.status != Status::ok) return true;
  return result.prosac.inliers < static_cast<std::size_t>(options_.min_inliers) ||
         overlap(result.prosac.homography, frame.grey.size()) < options_.min_overlap;
}

bool ReferenceKeeper::tryAgain(const Frame& frame, const MatchResult& result) {
  if (options_.mode != ReferenceMode::keyframe || reference_ == previous_) return false;
  if (!weak(frame, result)) return false;
  reference_ = previous_;
  to_reference_ = to_previous_;
  return true;
}

void ReferenceKeeper::advance(const FramePtr& frame, const MatchResult* result) {
  if (options_.mode == ReferenceMode::fixed) return;
  if (result == nullptr || result->status != Status::ok || !reference_) {
    restartAt(frame);
    return;
  }
  to_previous_ = normalised(result->prosac.homography * to_reference_);
  accumulated_ = Accumulated{first_stamp_, to_previous_};
  previous_ = frame;
  if (options_.mode == ReferenceMode::previous) {
    reference_ = previous_;
    to_reference_ = to_previous_;
  }
}

void ReferenceKeeper::restartAt(const FramePtr& frame) {
  reference_ = previous_ = frame;
  first_stamp_ = stamp(*frame);
  to_reference_ = to_previous_ = Eigen::Matrix3d::Identity();
  accumulated_.reset();
}

void ReferenceKeeper::reset() {
  reference_.reset();
  previous_.reset();
  accumulated_.reset();
}

void ReferenceKeeper::clear() {
  reset();
  fixed_.reset();
}

}  // namespace ktgp_orb
