#pragma once

#include <cstdint>
#include <opencv2/core.hpp>
#include <vector>

namespace ktgp_orb::sequence {

/// Recognises images that repeat the previous image: some drivers publish an image twice, and some
/// videos of 30 images a second are stored with 60.
///
/// An image with the same pixels is a repetition. If each copy was compressed anew, the differences
/// from the last new image alternate between large ones, from the motion, and much smaller ones. If
/// an image stays the same for longer than images usually take to change, the camera stands still.
/// From then on equal images count as new ones, so that results show the standstill.
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

  std::vector<double> differences_;  // of the newest images, grey levels
  std::vector<double> intervals_;    // between the newest images that changed, s
  bool stands_still_ = false;
};

}  // namespace ktgp_orb::sequence
