#include "tools/bag_reader.h"

#include <cv_bridge/cv_bridge.h>
#include <rosbag/bag.h>
#include <rosbag/view.h>
#include <sensor_msgs/CompressedImage.h>

#include <boost/make_shared.hpp>
#include <set>

#include "tools/bag_salvage.h"

namespace ktgp_orb {
namespace {

sensor_msgs::ImageConstPtr decoded(const sensor_msgs::CompressedImage& message) {
  try {
    return cv_bridge::toCvCopy(message)->toImageMsg();
  } catch (const std::exception&) {  // cv_bridge::Exception, cv::Exception
    return nullptr;
  }
}

std::string namesOfImageTopics(const rosbag::Bag& bag) {
  std::set<std::string> names;
  for (const rosbag::ConnectionInfo* connection : rosbag::View(bag).getConnections()) {
    if (isImageType(connection->datatype)) names.insert(connection->topic);
  }
  std::string list;
  for (const std::string& name : names) list += (list.empty() ? "" : ", ") + name;
  return list.empty() ? "none" : list;
}

/// A sound bag, by its index.
class IndexedBag : public ImageSource {
 public:
  IndexedBag(const std::string& path, const std::string& topic) : bag_(path) {
    view_.addQuery(bag_, [topic](const rosbag::ConnectionInfo* connection) {
      return connection->topic == topic && isImageType(connection->datatype);
    });
    if (view_.size() == 0) {
      throw UnusableBag(path + " has no image on '" + topic +
                        "'; its image topics: " + namesOfImageTopics(bag_));
    }
    next_ = view_.begin();
  }

  std::optional<RecordedImage> next() override {
    if (!damage_.empty() || next_ == view_.end()) return std::nullopt;
    try {
      const rosbag::MessageInstance& message = *next_;
      const RecordedImage image{imageOf(message), message.getTime()};
      ++next_;
      return image;
    } catch (const std::exception& error) {  // of rosbag or of the deserialisation
      damage_ = error.what();
      return std::nullopt;
    }
  }

  std::size_t total() const override { return view_.size(); }

 private:
  static sensor_msgs::ImageConstPtr imageOf(const rosbag::MessageInstance& message) {
    if (const auto image = message.instantiate<sensor_msgs::Image>()) return image;
    const auto compressed = message.instantiate<sensor_msgs::CompressedImage>();
    return compressed ? decoded(*compressed) : nullptr;
  }

  rosbag::Bag bag_;
  mutable rosbag::View view_;  // size() counts on the first call
  rosbag::View::iterator next_;
};

/// A bag without a usable index, record by record.
class SalvagedBag : public ImageSource {
 public:
  SalvagedBag(const std::string& path, std::string topic, const std::string& reason)
      : records_(path), topic_(std::move(topic)) {
    damage_ = reason;
  }

  std::optional<RecordedImage> next() override {
    while (const auto message = records_.next()) {
      if (message->topic != topic_ || !isImageType(message->type)) continue;
      if (const auto image = imageOf(*message)) return RecordedImage{*image, message->time};
    }
    if (!records_.damage().empty()) damage_ = records_.damage();
    return std::nullopt;
  }

 private:
  /// Nothing for bytes that are no message.
  static std::optional<sensor_msgs::ImageConstPtr> imageOf(SalvagedMessage message) {
    try {
      ros::serialization::IStream stream(message.data.data(),
                                         static_cast<std::uint32_t>(message.data.size()));
      if (message.type == "sensor_msgs/Image") {
        const auto image = boost::make_shared<sensor_msgs::Image>();
        ros::serialization::deserialize(stream, *image);
        return image;
      }
      sensor_msgs::CompressedImage compressed;
      ros::serialization::deserialize(stream, compressed);
      return decoded(compressed);
    } catch (const std::exception&) {
      return std::nullopt;
    }
  }

  BagRecords records_;
  std::string topic_;
};

}  // namespace

std::unique_ptr<ImageSource> openBag(const std::string& path, const std::string& topic) {
  try {
    return std::make_unique<IndexedBag>(path, topic);
  } catch (const rosbag::BagUnindexedException&) {
    return std::make_unique<SalvagedBag>(path, topic, "no index; was its recording cut off?");
  } catch (const rosbag::BagException& error) {
    return std::make_unique<SalvagedBag>(path, topic,
                                         std::string("unreadable index: ") + error.what());
  }
}

}  // namespace ktgp_orb
