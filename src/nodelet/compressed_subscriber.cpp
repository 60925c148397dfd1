// The image_transport plugin with which this package receives compressed images. It refuses images
// that exceed the limits of this package, and works without compressed_image_transport, which
// Debian 12 does not have. It has a name of its own, so that other nodes on the same machine keep
// using the plugin of compressed_image_transport.
#include <image_transport/simple_subscriber_plugin.h>
#include <sensor_msgs/CompressedImage.h>
#include <pluginlib/class_list_macros.hpp>

#include "ros/image_conversion.h"

namespace ktgp_orb {

class CompressedSubscriber
    : public image_transport::SimpleSubscriberPlugin<sensor_msgs::CompressedImage> {
 public:
  std::string getTransportName() const override { return "compressed"; }

 protected:
  void internalCallback(const sensor_msgs::CompressedImageConstPtr& message,
                        const Callback& take) override {
    sensor_msgs::ImageConstPtr image;
    try {
      image = decodedImage(*message);
    } catch (const RefusedImage& reason) {
      // Pass on an image without pixels. The node refuses and counts it, and reports the reason
      // that undecodedImage() stores in it.
      image = undecodedImage(message->header, reason);
    }
    take(image);
  }
};

}  // namespace ktgp_orb

PLUGINLIB_EXPORT_CLASS(ktgp_orb::CompressedSubscriber, image_transport::SubscriberPlugin)
