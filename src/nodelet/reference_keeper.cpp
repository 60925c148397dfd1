#include "nodelet/reference_keeper.h"

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

double secondsBetween(const ros::Time& earlier, const ros::Time& later) {
  const double seconds = static_cast<double>(later.sec) - static_cast<double>(earlier.sec);
  return seconds + 1e-9 * (static_cast<double>(later.nsec) - static_cast<double>(earlier.nsec));
}

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
  if (options.mode != options_.mode) forget();
  options_ = options;
}

FramePtr ReferenceKeeper::referenceFor(const Frame& next) {
  if (options_.mode == ReferenceMode::fixed) return fixed_;
  if (!previous_) return nullptr;
  // A keyframe may be old while frames keep coming; what must not be old is the frame before.
  const double gap = secondsBetween(stamp(*previous_), stamp(next));
  const bool same_sequence = gap >= 0.0 && gap <= options_.max_age &&
                             next.grey.size() == previous_->grey.size() &&
                             next.message->encoding == previous_->message->encoding;
  if (!same_sequence) forget();
  return reference_;
}

bool ReferenceKeeper::weak(const Frame& frame, const MatchResult& result) const {
  if (result.status != Status::ok) return true;
  return result.prosac.inliers < static_cast<std::size_t>(options_.min_inliers) ||
         overlap(result.prosac.homography, frame.grey.size()) < options_.min_overlap;
}

FramePtr ReferenceKeeper::secondChoice(const Frame& frame, const MatchResult& result) const {
  const bool another = options_.mode == ReferenceMode::keyframe && reference_ != previous_;
  return another && weak(frame, result) ? previous_ : nullptr;
}

void ReferenceKeeper::advance(const FramePtr& frame, const FramePtr& reference,
                              const MatchResult* result) {
  if (options_.mode == ReferenceMode::fixed) return;
  if (result == nullptr || result->status != Status::ok) {
    restartAt(frame);
    return;
  }
  const bool adjacent = reference == previous_;
  if (adjacent) {
    reference_ = previous_;
    to_reference_ = to_previous_;
  }
  to_previous_ = normalised(result->prosac.homography * to_reference_);
  accumulated_ = Accumulated{first_stamp_, to_previous_};
  previous_ = frame;
  // Two neighbouring frames of weak support: a keyframe would only be tried in vain.
  if (options_.mode == ReferenceMode::previous || (adjacent && weak(*frame, *result))) {
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

void ReferenceKeeper::forget() {
  reference_.reset();
  previous_.reset();
  accumulated_.reset();
}

}  // namespace ktgp_orb
