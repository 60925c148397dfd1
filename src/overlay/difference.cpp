#include "overlay/styles.h"

#include <algorithm>
#include <opencv2/core/eigen.hpp>
#include <opencv2/imgproc.hpp>

#include "overlay/canvas.h"

namespace ktgp_orb::overlay {
namespace {

cv::Mat toGrey(const cv::Mat& image) {
  if (image.type() != CV_8UC3) return image;
  cv::Mat grey;
  cv::cvtColor(image, grey, cv::COLOR_BGR2GRAY);
  return grey;
}

}  // namespace

void drawDifference(const FrameView& reference, const FrameView& target, const MatchResult& result,
                    cv::Mat& canvas) {
  canvas.create(target.image.size(), CV_8UC3);
  if (canvas.empty()) return;
  copyAsBgr(target.image, canvas);
  canvas.convertTo(canvas, -1, 0.3);
  if (result.status != Status::ok || reference.image.empty()) return;

  cv::Mat homography;
  cv::eigen2cv(result.answer.homography, homography);
  const cv::Mat grey = toGrey(target.image);
  cv::Mat warped;
  cv::Mat covered;
  cv::warpPerspective(toGrey(reference.image), warped, homography, grey.size(), cv::INTER_LINEAR);
  cv::warpPerspective(cv::Mat(reference.image.size(), CV_8UC1, cv::Scalar(255)), covered,
                      homography, grey.size(), cv::INTER_NEAREST);

  cv::Scalar target_mean;
  cv::Scalar target_deviation;
  cv::Scalar warped_mean;
  cv::Scalar warped_deviation;
  cv::meanStdDev(grey, target_mean, target_deviation, covered);
  cv::meanStdDev(warped, warped_mean, warped_deviation, covered);
  const double gain =
      std::clamp(target_deviation[0] / std::max(warped_deviation[0], 1.0), 0.25, 4.0);
  cv::Mat difference;
  cv::addWeighted(grey, 0.5, warped, -0.5 * gain,
                  128.0 - 0.5 * (target_mean[0] - gain * warped_mean[0]), difference);
  cv::Mat shown;
  cv::cvtColor(difference, shown, cv::COLOR_GRAY2BGR);
  shown.copyTo(canvas, covered);
}

}  // namespace ktgp_orb::overlay
