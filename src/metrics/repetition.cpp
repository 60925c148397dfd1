#include "metrics/repetition.h"

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>
#include <utility>

namespace ktgp_orb::metrics {

namespace {

// A picture repeats if its correlation with its shifted copy is at least this; tilted checkerboards
// reach 0.65 to 0.95.
constexpr double kAlike = 0.6;

// In a picture with a smaller standard deviation, grey levels, OpenCV finds a match everywhere.
constexpr double kLeastContrast = 1.0;

bool isPlain(const cv::Mat& picture) {
  cv::Scalar mean, deviation;
  cv::meanStdDev(picture, mean, deviation);
  return deviation[0] < kLeastContrast;
}

/// Returns the shifts, px, that move `part` of `picture` to a place where `other` looks alike; see
/// alikeShifts().
std::vector<cv::Point> shiftsOf(const cv::Rect& part, const cv::Mat& picture, const cv::Mat& other,
                                double least) {
  if (isPlain(picture(part))) return {{0, 0}};
  cv::Mat correlation, highest;
  cv::matchTemplate(other, picture(part), correlation, cv::TM_CCOEFF_NORMED);
  cv::dilate(correlation, highest, cv::Mat::ones(5, 5, CV_8U));
  std::vector<std::pair<float, cv::Point>> maxima;
  for (int y = 0; y < correlation.rows; ++y) {
    for (int x = 0; x < correlation.cols; ++x) {
      const float alike = correlation.at<float>(y, x);
      if (alike >= least && alike == highest.at<float>(y, x)) {
        maxima.emplace_back(alike, cv::Point(x, y) - part.tl());
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

/// Normalised correlation between the picture and a copy of it that is moved by `shift`, px, in the
/// area where the two overlap.
double alikeness(const cv::Mat& picture, const cv::Point& shift) {
  const cv::Rect all({0, 0}, picture.size());
  const cv::Rect moved = all & (all + shift);
  if (moved.empty()) return 0.0;
  const cv::Mat one = picture(moved), other = picture(moved - shift);
  cv::Scalar mean, deviation, other_mean, other_deviation;
  cv::meanStdDev(one, mean, deviation);
  cv::meanStdDev(other, other_mean, other_deviation);
  if (std::min(deviation[0], other_deviation[0]) < kLeastContrast) return 0.0;
  const double product = one.dot(other) / static_cast<double>(one.total());
  return (product - mean[0] * other_mean[0]) / (deviation[0] * other_deviation[0]);
}

/// Standard deviation of the blur that leaves only slow changes of brightness, px.
double shadeBlur(const cv::Mat& picture) {
  return 0.08 * std::max(picture.cols, picture.rows);
}

/// Removes slow changes of brightness from the picture, because they look alike everywhere.
cv::Mat withoutShades(const cv::Mat& picture) {
  cv::Mat shades, rest;
  cv::GaussianBlur(picture, shades, {}, shadeBlur(picture));
  cv::addWeighted(picture, 0.5, shades, -0.5, 128.0, rest);
  return rest;
}

/// As above, but ignores the parts where `weight` (CV_32FC1) is 0, and returns 0 there.
cv::Mat withoutShades(const cv::Mat& picture, const cv::Mat& weight) {
  cv::Mat rest, shades, share;
  picture.convertTo(rest, CV_32F);
  cv::GaussianBlur(rest.mul(weight), shades, {}, shadeBlur(picture));
  cv::GaussianBlur(weight, share, {}, shadeBlur(picture));
  cv::divide(shades, cv::max(share, 1e-3), shades);
  return (rest - shades).mul(weight);
}

// Shortest shift that counts as a period, as a share of the longer side.
constexpr double kShortestPeriod = 0.02;

bool isPeriod(const cv::Point& shift, const cv::Mat& picture) {
  return cv::norm(shift) >= kShortestPeriod * std::max(picture.cols, picture.rows);
}

/// Returns the shifts, px, after which the picture looks like itself, up to kLongestPeriod times
/// its sides. To find them, cuts out the two upper corners, each with two fifths of the width and
/// height, and searches for them in the whole picture. Two corners are enough for all directions,
/// because a picture that repeats after a shift also repeats after the opposite shift.
std::vector<cv::Point> farShifts(const cv::Mat& picture, double least) {
  constexpr double kPart = 1.0 - kLongestPeriod;
  const cv::Mat detail = withoutShades(picture);
  const cv::Size part(cvRound(kPart * picture.cols), cvRound(kPart * picture.rows));
  std::vector<cv::Point> far;
  for (const int left : {0, picture.cols - part.width}) {
    for (const cv::Point& shift : shiftsOf({{left, 0}, part}, detail, detail, least)) {
      if (alikeness(detail, shift) >= least) far.push_back(shift);
    }
  }
  return far;
}

}  // namespace

std::vector<cv::Point> alikeShifts(const cv::Mat& picture, const cv::Mat& other, double least) {
  const cv::Size half(std::min(picture.cols, other.cols) / 2,
                      std::min(picture.rows, other.rows) / 2);
  const cv::Point corner((picture.cols - half.width) / 2, (picture.rows - half.height) / 2);
  return shiftsOf({corner, half}, picture, other, least);
}

bool repeatsAfter(const cv::Mat& picture, const cv::Point2d& shift) {
  const bool is_in_sight = std::abs(shift.x) < kLongestPeriod * picture.cols &&
                           std::abs(shift.y) < kLongestPeriod * picture.rows;
  return !is_in_sight || alikeness(withoutShades(picture), shift) >= kAlike;
}

cv::Mat shrunk(const cv::Mat& picture) {
  // A period of kShortestPeriod is then still nearly 4 px long.
  constexpr double kCopySide = 192.0;
  const double scale = std::min(1.0, kCopySide / std::max(picture.cols, picture.rows));
  const auto side = [scale](int length) { return std::max(8, cvRound(scale * length)); };
  cv::Mat copy;
  cv::resize(picture, copy, {side(picture.cols), side(picture.rows)}, 0, 0, cv::INTER_AREA);
  return copy;
}

double alikeness(const cv::Mat& one, const cv::Mat& other, const cv::Mat& mask) {
  constexpr double kLeastShare = 0.02;
  const int pixels = cv::countNonZero(mask);
  if (pixels < kLeastShare * static_cast<double>(mask.total())) return 0.0;
  cv::Mat weight;
  cv::Mat(mask != 0).convertTo(weight, CV_32F, 1.0 / 255.0);
  const cv::Mat a = withoutShades(one, weight), b = withoutShades(other, weight);
  const double least = pixels * kLeastContrast * kLeastContrast;
  if (a.dot(a) < least || b.dot(b) < least) return 0.0;
  return a.dot(b) / std::sqrt(a.dot(a) * b.dot(b));
}

double alikenessToItself(const cv::Mat& picture) {
  // A corner can look less like its moved copy than the whole picture does.
  constexpr double kLeast = 0.25;
  const cv::Mat detail = withoutShades(picture);
  std::vector<cv::Point> shifts = alikeShifts(detail, detail, kLeast);
  const std::vector<cv::Point> far = farShifts(picture, kLeast);
  shifts.insert(shifts.end(), far.begin(), far.end());
  double most = 0.0;
  cv::Point best;
  for (const cv::Point& shift : shifts) {
    const double alike = isPeriod(shift, picture) ? alikeness(detail, shift) : 0.0;
    if (alike <= most) continue;
    most = alike;
    best = shift;
  }
  if (most == 0.0) return 0.0;
  // The shades near the border of the whole picture differ from those of its moved copy.
  const cv::Rect all({0, 0}, picture.size());
  const cv::Rect moved = all & (all + best);
  return std::max(
      0.0, alikeness(picture(moved), picture(moved - best), cv::Mat(moved.size(), CV_8UC1, 255)));
}

double shortestPeriod(const cv::Mat& picture) {
  const cv::Mat copy = shrunk(picture);
  const double scale =
      static_cast<double>(std::max(copy.cols, copy.rows)) / std::max(picture.cols, picture.rows);
  double shortest = 0.0;
  std::vector<cv::Point> shifts = alikeShifts(copy, copy, kAlike);
  const std::vector<cv::Point> far = farShifts(copy, kAlike);
  shifts.insert(shifts.end(), far.begin(), far.end());
  for (const cv::Point& shift : shifts) {
    if (!isPeriod(shift, copy)) continue;
    const double length = cv::norm(shift);
    shortest = shortest == 0.0 ? length : std::min(shortest, length);
  }
  return shortest / scale;
}

}  // namespace ktgp_orb::metrics
