#include "sequence/repeats.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>

namespace ktgp_orb::sequence {
namespace {

/// Mean absolute difference of the pixels on a grid, grey levels. A grid is used because comparing
/// whole rows of a large image would take as long as extracting its features.
double differenceOf(const cv::Mat& a, const cv::Mat& b) {
  constexpr int kStep = 5;  // px; has no common factor with 8 px, the side of a JPEG block
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

/// Appends the value to `values` and removes the oldest value if there are more than `most`.
void keep(double value, std::size_t most, std::vector<double>& values) {
  values.reserve(most);
  if (values.size() == most) values.erase(values.begin());
  values.push_back(value);
}

}  // namespace

bool Repeats::repeats(const cv::Mat& image, std::int64_t stamp, const cv::Mat& last,
                      std::int64_t last_stamp) {
  // Limit for stored intervals, s, because cameras with less than four images a second are rare.
  constexpr double kLongest = 0.25;
  constexpr std::size_t kIntervals = 8;
  if (image.empty() || image.size() != last.size() || image.type() != last.type()) return false;
  const double seconds = 1e-9 * (static_cast<double>(stamp) - static_cast<double>(last_stamp));
  if (seconds < 0.0) return false;
  const double difference = differenceOf(image, last);
  const bool is_equal = difference == 0.0 && areEqual(image, last);
  const bool is_same = isInLowerGroup(difference) || is_equal;
  if (is_equal && seconds == 0.0 && stamp != 0) return true;  // the same message came twice
  // Without stamps (0 s), a camera that stands still cannot be told from a camera that repeats
  // images.
  if (is_same && !stands_still_ && seconds > 0.0 && seconds <= patience()) return true;
  // Keep the interval, unless the camera continues to stand still. The first equal image after
  // patience() has passed may be a late repetition, so its interval is kept, too.
  if (seconds > 0.0 && !(is_same && stands_still_)) {
    keep(std::min(seconds, kLongest), kIntervals, intervals_);
  }
  stands_still_ = is_same;
  return false;
}

/// How long an image may stay the same before the camera counts as standing still, s.
double Repeats::patience() const {
  // Patience if no interval is known, s; cameras with less than ten images a second are rare.
  constexpr double kUnknown = 0.1;
  constexpr double kMore = 1.5;  // times the longest recent interval, because intervals vary
  if (intervals_.empty()) return kUnknown;
  return kMore * *std::max_element(intervals_.begin(), intervals_.end());
}

/// Whether the differences alternate between two groups, and `difference` is in the lower group. If
/// a motion slows down, some differences lie between the groups, so the result is false. If a
/// motion stops, the result is false, too: the differences fall to the lower group only once.
bool Repeats::isInLowerGroup(double difference) {
  constexpr std::size_t kImages = 16;
  constexpr double kLeast = 0.05;  // grey levels; the noise of compression is larger
  // Minimum ratio between the groups; differences after equal compressions have ratios of up
  // to 1.2.
  constexpr double kApart = 2.5;
  constexpr double kAlike = 2.0;  // maximum ratio of differences within the lower group
  constexpr int kTimes = 3;       // minimum number of falls to the lower group
  keep(std::max(difference, kLeast), kImages, differences_);
  std::array<double, kImages> sorted{};
  const auto end = std::copy(differences_.begin(), differences_.end(), sorted.begin());
  std::sort(sorted.begin(), end);
  const auto first_above =
      std::find_if(sorted.begin(), end, [&](double d) { return d > kAlike * sorted[0]; });
  if (first_above == end || *first_above < kApart * *(first_above - 1)) return false;
  int falls = 0;
  for (std::size_t i = 1; i < differences_.size(); ++i) {
    falls += differences_[i] < *first_above && differences_[i - 1] >= *first_above ? 1 : 0;
  }
  return falls >= kTimes && differences_.back() < *first_above;
}

}  // namespace ktgp_orb::sequence
