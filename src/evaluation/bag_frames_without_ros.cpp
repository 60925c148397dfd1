#include "cli/files.h"
#include "evaluation/bag_frames.h"

namespace ktgp_orb::tools {

void readBag(const std::string& file, const std::string& /*topic*/,
             const std::string& /*truth_topic*/, const FrameVisitor& /*visit*/) {
  throw FileError(file, "cannot be read: this program was built without ROS");
}

}  // namespace ktgp_orb::tools
