#include "nodelet/outputs.h"

#include <algorithm>
#include <utility>

namespace ktgp_orb {

void Outputs::open(const ros::NodeHandle& node, Callback changed) {
  node_ = node;
  transport_ = std::make_unique<image_transport::ImageTransport>(node_);
  changed_ = std::move(changed);
}

image_transport::Publisher Outputs::advertiseImage(const std::string& topic,
                                                   std::uint32_t queue_size, bool latch,
                                                   const Callback& came) {
  const auto connected = [this, came](const image_transport::SingleSubscriberPublisher&) {
    changed_();
    came();
  };
  const auto disconnected = [this](const image_transport::SingleSubscriberPublisher&) {
    changed_();
  };
  images_.push_back(
      transport_->advertise(topic, queue_size, connected, disconnected, ros::VoidPtr(), latch));
  return images_.back();
}

bool Outputs::haveSubscribers() const {
  const auto has = [](const auto& publisher) { return publisher.getNumSubscribers() > 0; };
  return std::any_of(topics_.begin(), topics_.end(), has) ||
         std::any_of(images_.begin(), images_.end(), has);
}

void Outputs::shutdown() {
  for (ros::Publisher& topic : topics_) topic.shutdown();
  for (image_transport::Publisher& image : images_) image.shutdown();
}

}  // namespace ktgp_orb
