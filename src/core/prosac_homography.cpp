#include "ktgp_orb/prosac_homography.h"

#include <Eigen/Geometry>
#include <opencv2/calib3d.hpp>
#include <opencv2/core/eigen.hpp>

#include "options_check.h"

namespace ktgp_orb {

ProsacHomography::ProsacHomography(const ProsacOptions& options) : options_(options) {
  requireInRange("prosac threshold", options.threshold, 1e-6, 1e6);
  requireInRange("max_iterations", options.max_iterations, 1, 1000000);
  requireInRange("confidence", options.confidence, 1e-6, 1.0 - 1e-9);
}

// Stand-in: plain RANSAC. The progressive sampling follows in its own change.
void ProsacHomography::estimate(const PointPairs& pairs, const cv::Size& /*reference_size*/,
                                ProsacResult& result) {
  result = {};
  result.mask.assign(pairs.size(), 0);
  if (pairs.size() < 4) {
    result.status = Status::too_few_matches;
    return;
  }
  std::vector<cv::Point2d> reference;
  std::vector<cv::Point2d> target;
  for (std::size_t i = 0; i < pairs.size(); ++i) {
    reference.emplace_back(pairs.reference[i].x(), pairs.reference[i].y());
    target.emplace_back(pairs.target[i].x(), pairs.target[i].y());
  }
  const cv::Mat h = cv::findHomography(reference, target, cv::RANSAC, options_.threshold);
  if (h.empty()) return;
  cv::cv2eigen(h, result.homography);
  double sum = 0.0;
  for (std::size_t i = 0; i < pairs.size(); ++i) {
    const Eigen::Vector3d p = result.homography * pairs.reference[i].homogeneous();
    const double error = (p.hnormalized() - pairs.target[i]).squaredNorm();
    if (!(error < options_.threshold * options_.threshold)) continue;
    result.mask[i] = 1;
    ++result.inliers;
    sum += error;
  }
  result.rmse = result.inliers > 0 ? std::sqrt(sum / static_cast<double>(result.inliers)) : 0.0;
  result.status = Status::ok;
}

}  // namespace ktgp_orb
