#pragma once

#include <cstdint>
#include <opencv2/core.hpp>
#include <vector>

namespace ktgp_orb::sequence {

/// Recognises images that repeat the one before: drivers publish an image twice, videos of 30
/// images a second are stored with 60.
///
/// The same pixels are a repetition. Where each copy was compressed anew, the differences to the
/// last new image fall into two groups that alternate: those of the motion, and much smaller ones.
/// A camera that stands still repeats its image for longer than images take to change; from then on
/// its images are new ones, which show that it stands.
class Repeats {
 public:
  /// Whether `image`, taken at `stamp` ns, repeats `last`, the last image that was not a
  /// repetition. Both CV_8UC1.
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
