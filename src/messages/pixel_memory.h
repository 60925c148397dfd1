#pragma once

#include <sensor_msgs/Image.h>

#include <memory>
#include <opencv2/core.hpp>

#include "core/util/pool.h"
#include "core/util/shared_matrix.h"

namespace ktgp_orb {

/// The memory of a frame's pixels: the message, or a matrix with the converted pixels.
struct PixelMemory {
  sensor_msgs::ImageConstPtr message;
  cv::Mat grey;
};

/// Hands out memory for frames and reuses it when it is free again, so that in steady state no
/// image needs an allocation.
class PixelMemoryPool {
 public:
  std::shared_ptr<PixelMemory> take() {
    std::shared_ptr<PixelMemory> memory = all_.take();
    // A caller may hold the matrix without the frame.
    if (util::isShared(memory->grey)) memory->grey.release();
    return memory;
  }

 private:
  util::Pool<PixelMemory> all_{8, [](PixelMemory& memory) { memory.message.reset(); }};
};

}  // namespace ktgp_orb
