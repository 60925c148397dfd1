#include "evaluation/peers.h"

#include <algorithm>
#include <limits>
#include <opencv2/core/eigen.hpp>
#include <opencv2/core/version.hpp>
#include <opencv2/features2d.hpp>
#include <opencv2/imgproc.hpp>
#include <opencv2/video/tracking.hpp>

// SIFT is in features2d since OpenCV 4.4; before, distributions did not ship its module.
#define KTGP_ORB_HAVE_SIFT (CV_VERSION_MAJOR > 4 || (CV_VERSION_MAJOR == 4 && CV_VERSION_MINOR > 3))

namespace ktgp_orb::evaluation {
namespace {

using Detector = cv::Ptr<cv::Feature2D>;

void describe(const Detector& detector, const cv::Mat& image, Features& features) {
  features.image_size = image.size();
  detector->detectAndCompute(image, cv::noArray(), features.keypoints, features.descriptors);
}

Step detect(const Detector& detector) {
  return {"detect", [detector](const Scene& scene, Matching& m) {
            m.own.emplace();
            describe(detector, scene.reference_image, m.own->reference);
            describe(detector, scene.target_image, m.own->target);
          }};
}

/// Matches every target descriptor to the nearest reference descriptor, if its distance is below
/// `threshold` times the second distance (Lowe 2004).
Step nearestByRatio(int norm, double threshold) {
  return {"match", [norm, threshold](const Scene&, Matching& m) {
            const Features& reference = m.own->reference;
            const Features& target = m.own->target;
            if (reference.size() < 2 || target.empty()) return;
            std::vector<std::vector<cv::DMatch>> candidates;
            cv::BFMatcher(norm).knnMatch(target.descriptors, reference.descriptors, candidates, 2);
            for (const auto& pair : candidates) {
              if (pair.size() < 2) continue;
              const float d1 = pair[0].distance;
              const float d2 = pair[1].distance;
              if (!(d1 < threshold * d2)) continue;
              m.matches.push_back({pair[0].trainIdx, pair[0].queryIdx, cvRound(d1), cvRound(d2)});
            }
          }};
}

constexpr int kCorners = 500;

/// Detects corners of the reference (Shi & Tomasi 1994).
Step corners() {
  return {"corners", [](const Scene& scene, Matching& m) {
            constexpr double kQuality = 0.01;  // share of the best corner's quality
            constexpr double kApart = 7.0;     // px
            std::vector<cv::Point2f> points;
            cv::goodFeaturesToTrack(scene.reference_image, points, kCorners, kQuality, kApart);
            m.own.emplace();
            m.own->reference.image_size = m.own->target.image_size = scene.reference_image.size();
            for (const auto& p : points) m.own->reference.keypoints.emplace_back(p, 1.F);
          }};
}

/// Tracks the corners into the target: pyramidal Lucas-Kanade (Bouguet 2000), OpenCV's defaults.
Step opticalFlow() {
  return {"flow", [](const Scene& scene, Matching& m) {
            std::vector<cv::Point2f> from;
            std::vector<cv::Point2f> to;
            std::vector<std::uint8_t> followed;
            cv::KeyPoint::convert(m.own->reference.keypoints, from);
            if (from.empty()) return;
            cv::calcOpticalFlowPyrLK(scene.reference_image, scene.target_image, from, to, followed,
                                     cv::noArray());
            for (std::size_t i = 0; i < to.size(); ++i) {
              const auto index = static_cast<std::int32_t>(i);
              m.own->target.keypoints.emplace_back(to[i], 1.F);
              if (followed[i] != 0) m.matches.push_back({index, index, 0, 0});
            }
          }};
}

/// Finds the homography that maximises the correlation of the images, starting from the identity
/// (Evangelidis & Psarakis 2008). There are no matches.
Step ecc() {
  return {"ecc", [](const Scene& scene, Matching& m) {
            const cv::TermCriteria until(cv::TermCriteria::COUNT | cv::TermCriteria::EPS, 50, 1e-4);
            m.own.emplace();
            m.estimated = true;
            cv::Mat h = cv::Mat::eye(3, 3, CV_32F);
            try {
              cv::findTransformECC(scene.reference_image, scene.target_image, h,
                                   cv::MOTION_HOMOGRAPHY, until);
            } catch (const cv::Exception&) {
              return;  // ECC reports by an exception that it did not converge
            }
            Eigen::Matrix3f found;
            cv::cv2eigen(h, found);
            if (!found.allFinite()) return;
            m.answer.emplace().homography = found.cast<double>();
            m.answer->covariance.setConstant(std::numeric_limits<double>::quiet_NaN());
          }};
}

/// A method that runs the steps, then the estimator. If this OpenCV cannot run it, the method has
/// the reason.
Method peer(const std::string& name, const std::string& description, std::vector<Step> steps,
            const std::string& estimator, const ProsacOptions& options) {
  if (steps.empty()) return {name, description, {}, "it needs 4.4"};
  const std::vector<std::string> known = estimators();
  if (std::find(known.begin(), known.end(), estimator) == known.end()) {
    return {name, description, {}, "its estimator needs 4.6"};
  }
  steps.push_back(homography(estimator, options));
  return {name, description, std::move(steps)};
}

std::vector<Step> siftSteps(double threshold) {
#if KTGP_ORB_HAVE_SIFT
  constexpr int kFeatures = 2000;
  return {detect(cv::SIFT::create(kFeatures)), nearestByRatio(cv::NORM_L2, threshold)};
#else
  static_cast<void>(threshold);
  return {};
#endif
}

}  // namespace

std::vector<Method> peerMethods(const ProsacOptions& options, const std::string& wanted) {
  constexpr double kRatio = 0.8;
  const std::string estimator = wanted.empty() ? "magsac" : wanted;
  std::vector<Method> methods{
      peer("SIFT", "2000 SIFT keypoints, ratio 0.8, MAGSAC++", siftSteps(kRatio), estimator,
           options),
      peer("AKAZE", "AKAZE keypoints, ratio 0.8, MAGSAC++",
           {detect(cv::AKAZE::create()), nearestByRatio(cv::NORM_HAMMING, kRatio)}, estimator,
           options),
      peer("FLOW", "500 corners, pyramidal optical flow, MAGSAC++", {corners(), opticalFlow()},
           estimator, options),
      {"ECC", "dense alignment from the identity", {ecc()}},
  };
  for (Method& method : methods) {
    if (method.unavailable.empty()) continue;
    method.unavailable = "not available in this OpenCV (" CV_VERSION "): " + method.unavailable;
  }
  return methods;
}

}  // namespace ktgp_orb::evaluation
