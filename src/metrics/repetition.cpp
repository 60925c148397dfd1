#include "metrics/repetition.h"

#include <algorithm>
#include <opencv2/imgproc.hpp>
#include <utility>

namespace ktgp_orb::metrics {

std::vector<cv::Point> alikeShifts(const cv::Mat& picture, const cv::Mat& other, double least) {
  const cv::Size half(std::min(picture.cols, other.cols) / 2,
                      std::min(picture.rows, other.rows) / 2);
  const cv::Point corner((picture.cols - half.width) / 2, (picture.rows - half.height) / 2);
  const cv::Mat middle = picture(cv::Rect(corner, half));
  cv::Scalar mean, deviation;
  cv::meanStdDev(middle, mean, deviation);
  constexpr double kLeastContrast = 1.0;  // grey levels: OpenCV finds a plain one everywhere
  if (deviation[0] < kLeastContrast) return {{0, 0}};
  cv::Mat correlation, highest;
  cv::matchTemplate(other, middle, correlation, cv::TM_CCOEFF_NORMED);
  cv::dilate(correlation, highest, cv::Mat::ones(5, 5, CV_8U));
  std::vector<std::pair<float, cv::Point>> maxima;
  for (int y = 0; y < correlation.rows; ++y) {
    for (int x = 0; x < correlation.cols; ++x) {
      const float alike = correlation.at<float>(y, x);
      if (alike >= least && alike == highest.at<float>(y, x)) {
        maxima.emplace_back(alike, cv::Point(x, y) - corner);
      }
    }
  }
  std::stable_sort(maxima.begin(), maxima.end(),
                   [](const auto& a, const auto& b) { return a.first > b.first; });
  std::vector<cv::Point> shifts;
  shifts.reserve(maxima.size());
  for (const auto& maximum : maxima) shifts.push_back(maximum.second);
  return shifts;
}

double shortestPeriod(const cv::Mat& picture) {
  constexpr double kCopySide = 96.0;  // px: finer detail does not tell where the camera is
  constexpr double kAlike = 0.6;      // a checkerboard below a tilted camera has 0.65 to 0.95
  constexpr double kLeast = 0.04;     // share of the side
  const double scale = std::min(1.0, kCopySide / std::max(picture.cols, picture.rows));
  const auto side = [scale](int length) { return std::max(8, cvRound(scale * length)); };
  cv::Mat copy;
  cv::resize(picture, copy, {side(picture.cols), side(picture.rows)}, 0, 0, cv::INTER_AREA);
  double shortest = 0.0;
  for (const cv::Point& shift : alikeShifts(copy, copy, kAlike)) {
    const double length = cv::norm(shift);
    if (length < kLeast * std::max(copy.cols, copy.rows)) continue;
    shortest = shortest == 0.0 ? length : std::min(shortest, length);
  }
  return shortest / scale;
}

}  // namespace ktgp_orb::metrics
