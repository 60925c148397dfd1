#pragma once

#include <sensor_msgs/Image.h>

#include <memory>
#include <opencv2/core.hpp>
#include <vector>

#include "core/util/shared_matrix.h"

namespace ktgp_orb {

/// The memory of a frame's pixels: the message, or a matrix with the converted pixels.
struct PixelMemory {
  sensor_msgs::ImageConstPtr message;
  cv::Mat grey;
};

/// Hands out memory for frames and reuses it when it is free again, so that in steady state no
/// image needs an allocation. A message is released when the next image arrives.
class PixelMemoryPool {
 public:
  std::shared_ptr<PixelMemory> take() {
    std::shared_ptr<PixelMemory> free;
    for (const std::shared_ptr<PixelMemory>& one : all_) {
      if (one.use_count() > 1) continue;
      // The copy orders memory accesses: all reads of the last holder come before the next write.
      free = one;
      free->message.reset();
    }
    if (!free) {
      free = std::make_shared<PixelMemory>();
      if (all_.size() < kMost) all_.push_back(free);
    }
    // A caller may hold the matrix without the frame.
    if (util::isShared(free->grey)) free->grey.release();
    return free;
  }

 private:
  static constexpr std::size_t kMost = 8;  // a caller may keep frames for ever
  std::vector<std::shared_ptr<PixelMemory>> all_;
};

}  // namespace ktgp_orb
