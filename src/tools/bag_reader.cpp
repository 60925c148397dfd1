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

std::set<std::string> imageTopics(const rosbag::Bag& bag) {
  std::set<std::string> names;
  for (const rosbag::ConnectionInfo* connection : rosbag::View(bag).getConnections()) {
    if (isImageType(connection->datatype)) names.insert(connection->topic);
  }
  return names;
}

std::string joined(const std::set<std::string>& names) {
  std::string list;
  for (const std::string& name : names) list += (list.empty() ? "" : ", ") + name;
  return list.empty() ? "none" : list;
}

[[noreturn]] void refuseTopic(const std::string& path, const std::string& topic,
                              const std::set<std::string>& names) {
  const std::string has =
      topic.empty() ? " has no single image topic" : " has no image on '" + topic + "'";
  throw UnusableBag(path + has + "; its image topics: " + joined(names));
}

/// A sound bag, by its index.
class IndexedBag : public ImageSource {
 public:
  IndexedBag(const std::string& path, const BagSelection& selection) : bag_(path) {
    const std::set<std::string> names = imageTopics(bag_);
    topic_ = selection.topic;
    if (topic_.empty() && names.size() == 1) topic_ = *names.begin();
    if (names.count(topic_) == 0) refuseTopic(path, selection.topic, names);
    const ros::Time begin = rosbag::View(bag_).getBeginTime() + ros::Duration(selection.start);
    const ros::Time end =
        selection.duration < 0.0 ? ros::TIME_MAX : begin + ros::Duration(selection.duration);
    view_.addQuery(
        bag_,
        [this](const rosbag::ConnectionInfo* connection) {
          return connection->topic == topic_ && isImageType(connection->datatype);
        },
        begin, end);
    if (view_.size() == 0) {
      throw UnusableBag(path + " has no image on '" + topic_ + "' in the time asked for");
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
  SalvagedBag(const std::string& path, const BagSelection& selection, const std::string& reason)
      : records_(path), selection_(selection) {
    topic_ = selection.topic.empty() ? onlyImageTopic(path) : selection.topic;
    damage_ = reason;
  }

  std::optional<RecordedImage> next() override {
    while (const auto message = records_.next()) {
      if (!begin_) begin_ = message->time + ros::Duration(selection_.start);
      if (message->topic != topic_ || !isImageType(message->type) || !isWanted(message->time)) {
        continue;
      }
      if (const auto image = imageOf(*message)) return RecordedImage{*image, message->time};
    }
    if (!records_.damage().empty()) damage_ = records_.damage();
    return std::nullopt;
  }

 private:
  /// Reads the bag once to its damage.
  static std::string onlyImageTopic(const std::string& path) {
    BagRecords records(path);
    std::set<std::string> names;
    while (const auto message = records.next()) {
      if (isImageType(message->type)) names.insert(message->topic);
    }
    if (names.size() != 1) refuseTopic(path, "", names);
    return *names.begin();
  }

  bool isWanted(const ros::Time& time) const {
    return time >= *begin_ &&
           (selection_.duration < 0.0 || time <= *begin_ + ros::Duration(selection_.duration));
  }

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
  BagSelection selection_;
  std::optional<ros::Time> begin_;
};

}  // namespace

std::unique_ptr<ImageSource> openBag(const std::string& path, const BagSelection& selection) {
  try {
    return std::make_unique<IndexedBag>(path, selection);
  } catch (const rosbag::BagUnindexedException&) {
    return std::make_unique<SalvagedBag>(path, selection, "no index; was its recording cut off?");
  } catch (const rosbag::BagException& error) {
    return std::make_unique<SalvagedBag>(path, selection,
                                         std::string("unreadable index: ") + error.what());
  }
}

}  // namespace ktgp_orb
