#pragma once

#include <cstdint>
#include <opencv2/core.hpp>
#include <vector>

namespace ktgp_orb::sequence {

/// Recognises images that repeat the one before: drivers publish an image twice, videos of 30
/// images a second are stored with 60.
///
/// The same pixels are a repetition. If each copy was compressed anew, the differences to the last
/// new image fall into two groups that alternate: those of the motion, and much smaller ones. If an
/// image stays the same for longer than images usually take to change, the camera stands still:
/// from then on equal images count as new ones, so that results show the standstill.
class Repeats {
 public:
  /// Whether `image`, taken at `stamp` ns, is a repetition of `last`, the newest image that was not
  /// a repetition. Both images are CV_8UC1.
  bool repeats(const cv::Mat& image, std::int64_t stamp, const cv::Mat& last,
               std::int64_t last_stamp);
  void forget() { *this = {}; }

 private:
  bool isInLowerGroup(double difference);
  double patience() const;

  std::vector<double> differences_;  // grey levels, of the newest images
  std::vector<double> intervals_;    // s, between the newest images that changed
  bool stands_still_ = false;
};

}  // namespace ktgp_orb::sequence
