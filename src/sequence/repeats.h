#pragma once

#include <cstdint>
#include <opencv2/core.hpp>
#include <vector>

namespace ktgp_orb::sequence {

/// Recognises images that repeat the previous image. Some drivers publish an image twice, and some
/// videos of 30 images a second are stored with 60 images a second.
///
/// An image with the same pixels is a repetition. If each copy was compressed anew, the pixels
/// differ a little. The differences from the last new image then alternate between large values,
/// due to the motion, and much smaller values. If an image stays the same for longer than images
/// usually take to change, the camera stands still. From then on, equal images count as new images,
/// so that the results show the standstill.
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

  // For each of the newest images: its difference from the last image that was no repetition.
  std::vector<double> differences_;
  std::vector<double> intervals_;  // intervals between the newest images that changed, s
  bool stands_still_ = false;
};

}  // namespace ktgp_orb::sequence
