#include "sequence/repeats.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>

namespace ktgp_orb::sequence {
namespace {

/// Mean absolute difference of two images, in grey levels. Compares only pixels on a grid: in a
/// large image, comparing all pixels would take as long as extracting its features.
double differenceOf(const cv::Mat& a, const cv::Mat& b) {
  // px; 5 has no common factor with 8, the side of a JPEG block in px, so the grid meets every
  // position within the blocks.
  constexpr int kStep = 5;
  std::int64_t sum = 0;
  std::int64_t count = 0;
  for (int y = 0; y < a.rows; y += kStep) {
    const auto* const row_a = a.ptr<std::uint8_t>(y);
    const auto* const row_b = b.ptr<std::uint8_t>(y);
    for (int x = 0; x < a.cols; x += kStep) sum += std::abs(int(row_a[x]) - int(row_b[x]));
    count += (a.cols + kStep - 1) / kStep;
  }
  return static_cast<double>(sum) / static_cast<double>(std::max<std::int64_t>(count, 1));
}

bool areEqual(const cv::Mat& a, const cv::Mat& b) {
  for (int y = 0; y < a.rows; ++y) {
    if (!std::equal(a.ptr(y), a.ptr(y) + a.cols, b.ptr(y))) return false;
  }
  return true;
}

/// Appends `value` to `values`. If there are already `most` values, removes the oldest one.
void keep(double value, std::size_t most, std::vector<double>& values) {
  values.reserve(most);
  if (values.size() == most) values.erase(values.begin());
  values.push_back(value);
}

}  // namespace

bool Repeats::repeats(const cv::Mat& image, std::int64_t stamp, const cv::Mat& last,
                      std::int64_t last_stamp) {
  // Seconds; longer intervals are stored as this value. Otherwise a pause would make patience() too
  // long. Cameras with less than four images a second are rare.
  constexpr double kLongest = 0.25;
  constexpr std::size_t kIntervals = 8;
  if (image.empty() || image.size() != last.size() || image.type() != last.type()) return false;
  const double seconds = 1e-9 * (static_cast<double>(stamp) - static_cast<double>(last_stamp));
  if (seconds < 0.0) return false;
  const double difference = differenceOf(image, last);
  const bool is_equal = difference == 0.0 && areEqual(image, last);
  const Alternation alternation = alternationWith(difference);
  const bool is_same = alternation.row > 0 || is_equal;
  if (is_equal && seconds == 0.0 && stamp != 0) return true;  // same message twice
  // If the messages have no stamps, `seconds` is 0. Then we cannot tell a camera that stands still
  // from a camera that repeats images, so the image is not called a repetition.
  //
  // Equal pixels that alternate with new ones are repetitions at any rate, unless there are more in
  // a row than before: then the camera has stopped.
  const bool is_usual = alternation.row > 0 && alternation.row <= alternation.longest;
  const bool is_soon = seconds <= patience() || (is_equal && is_usual);
  if (is_same && !stands_still_ && seconds > 0.0 && is_soon) return true;
  // Store the time since the last new image, but not while the camera stands still. For the first
  // equal image that comes after patience() has passed, the time is stored, because the image may
  // be a repetition that came late.
  if (seconds > 0.0 && !(is_same && stands_still_)) {
    keep(std::min(seconds, kLongest), kIntervals, intervals_);
  }
  stands_still_ = is_same;
  return false;
}

/// How long an image may stay the same, s. If it stays the same for longer, we say that the camera
/// stands still.
double Repeats::patience() const {
  // The patience in s as long as no interval is known. Cameras with less than ten images a second
  // are rare.
  constexpr double kUnknown = 0.1;
  constexpr double kMore = 1.5;  // multiple of the longest recent interval; intervals vary
  if (intervals_.empty()) return kUnknown;
  return kMore * *std::max_element(intervals_.begin(), intervals_.end());
}

/// Adds `difference`, and finds whether the differences alternate between a group of large and a
/// group of small values, and `difference` belongs to the small values. While a motion slows down,
/// some differences lie between the groups, so there is no alternation. When a motion stops, the
/// differences become small only once, so there is none, either.
Repeats::Alternation Repeats::alternationWith(double difference) {
  constexpr std::size_t kImages = 16;
  constexpr double kLeast = 0.05;  // grey levels; smaller differences are set to this
  // The smallest of the large differences must be at least this many times the largest of the small
  // ones. If all images are compressed in the same way, differences vary by a factor of up to 1.2.
  constexpr double kApart = 2.5;
  // A difference up to this many times the smallest one counts as small.
  constexpr double kAlike = 2.0;
  constexpr int kTimes = 3;  // minimum number of falls from a large to a small difference
  keep(std::max(difference, kLeast), kImages, differences_);
  std::array<double, kImages> sorted{};
  const auto end = std::copy(differences_.begin(), differences_.end(), sorted.begin());
  std::sort(sorted.begin(), end);
  const auto first_above =
      std::find_if(sorted.begin(), end, [&](double d) { return d > kAlike * sorted[0]; });
  if (first_above == end || *first_above < kApart * *(first_above - 1)) return {};
  int falls = 0;
  Alternation found;
  for (std::size_t i = 0; i < differences_.size(); ++i) {
    const bool is_small = differences_[i] < *first_above;
    falls += is_small && i > 0 && differences_[i - 1] >= *first_above ? 1 : 0;
    if (!is_small) found.longest = std::max(found.longest, found.row);
    found.row = is_small ? found.row + 1 : 0;
  }
  return falls >= kTimes ? found : Alternation();
}

}  // namespace ktgp_orb::sequence
