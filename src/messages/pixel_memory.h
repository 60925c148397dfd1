#pragma once

#include <sensor_msgs/Image.h>

#include <memory>
#include <opencv2/core.hpp>
#include <vector>

#include "core/util/shared_matrix.h"

namespace ktgp_orb {

/// What the pixels of a frame lie in: the message, or a matrix that they were converted into.
struct PixelMemory {
  sensor_msgs::ImageConstPtr message;
  cv::Mat grey;
};

/// Hands out memory for frames and takes it back once nobody holds it, so that in steady state
/// nothing is allocated for an image. A message is let go when the next image comes.
class PixelMemoryPool {
 public:
  std::shared_ptr<PixelMemory> take() {
    std::shared_ptr<PixelMemory> free;
    for (const std::shared_ptr<PixelMemory>& one : all_) {
      if (one.use_count() > 1) continue;
      // Copied, which makes all that its last holder read come before what is done with it now.
      free = one;
      free->message.reset();
    }
    if (!free) {
      free = std::make_shared<PixelMemory>();
      if (all_.size() < kMost) all_.push_back(free);
    }
    // A caller may hold the matrix, though not the frame that had it.
    if (util::isShared(free->grey)) free->grey.release();
    return free;
  }

 private:
  static constexpr std::size_t kMost = 8;  // a caller may keep frames for ever
  std::vector<std::shared_ptr<PixelMemory>> all_;
};

}  // namespace ktgp_orb
