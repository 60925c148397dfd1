#include "nodelet/frame.h"

#include <chrono>

#include "nodelet/image_conversion.h"

namespace ktgp_orb {

FramePtr makeFrame(const sensor_msgs::ImageConstPtr& message, OrbExtractor& extractor) {
  auto frame = std::make_shared<Frame>();
  frame->message = message;
  frame->grey = greyImage(message);
  extractAgain(extractor, *frame);
  return frame;
}

void extractAgain(OrbExtractor& extractor, Frame& frame) {
  const auto start = std::chrono::steady_clock::now();
  extractor.extract(frame.grey, frame.features);
  frame.extraction_milliseconds =
      std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - start).count();
  frame.orb = extractor.options();
}

}  // namespace ktgp_orb
