#pragma once

#include <cstdint>
#include <opencv2/core.hpp>
#include <vector>

namespace ktgp_orb::sequence {

/// Recognises images that repeat the previous image. Some drivers publish every image twice, and
/// some videos with 30 images a second are stored with 60 images a second.
///
/// An image with exactly the same pixels is a repetition. If the copy was compressed once more, its
/// pixels differ a little: the differences from the last new image then alternate between large
/// values, due to the motion, and much smaller values. If the image stays the same for longer than
/// the camera usually needs for a new image (1.5 times the longest interval, at most 0.375 s; 0.1 s
/// while no interval is known), the camera stands still. From then on, equal images count as new
/// images, so that the results show the standstill. A slower camera repeats images for longer than
/// this time. So equal images that alternate with new images are repetitions whatever the interval,
/// unless more equal images follow each other than before.
class Repeats {
 public:
  /// Returns true if `image` is a repetition of `last`, the newest image that was not a repetition.
  /// `stamp`, `last_stamp`: times of these images, ns. Both images are CV_8UC1.
  bool repeats(const cv::Mat& image, std::int64_t stamp, const cv::Mat& last,
               std::int64_t last_stamp);
  void forget() { *this = {}; }

 private:
  /// Number of successive images with small differences in an alternation; see alternationWith().
  struct Alternation {
    // Length of the row that ends with the newest image; 0 if its difference is not small, or if
    // the differences do not alternate.
    int row = 0;
    int longest = 0;  // length of the longest earlier row
  };

  Alternation alternationWith(double difference);
  double patience() const;

  // For each of the newest images: its mean absolute difference from the last image before it that
  // was not a repetition, grey levels.
  std::vector<double> differences_;
  std::vector<double> intervals_;  // times from one new image to the next, s
  bool stands_still_ = false;
};

}  // namespace ktgp_orb::sequence
