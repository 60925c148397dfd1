#include "evaluation/bag_frames.h"

#include <cv_bridge/cv_bridge.h>
#include <ktgp_orb/HomographyStamped.h>
#include <rosbag/bag.h>
#include <rosbag/view.h>
#include <sensor_msgs/CompressedImage.h>
#include <sensor_msgs/Image.h>
#include <sensor_msgs/image_encodings.h>

#include <boost/make_shared.hpp>
#include <map>
#include <set>

#include "bag/reader.h"
#include "cli/files.h"
#include "messages/image_conversion.h"

namespace ktgp_orb::tools {
namespace {

/// The true homographies by the stamp of their target image.
std::map<ros::Time, HomographyStamped> readTruth(const rosbag::Bag& bag, const std::string& topic) {
  std::map<ros::Time, HomographyStamped> truth;
  for (const rosbag::MessageInstance& message : rosbag::View(bag, rosbag::TopicQuery(topic))) {
    const auto homography = message.instantiate<HomographyStamped>();
    if (homography) truth[homography->header.stamp] = *homography;
  }
  return truth;
}

/// The image as 8-bit grey with its stamp; null for a message that is no image.
cv_bridge::CvImageConstPtr toGrey(const rosbag::MessageInstance& message) {
  sensor_msgs::ImageConstPtr image = message.instantiate<sensor_msgs::Image>();
  if (!image) {
    const auto compressed = message.instantiate<sensor_msgs::CompressedImage>();
    if (!compressed) return nullptr;
    image = decodedImage(*compressed);
    if (!image) return nullptr;
  }
  return boost::make_shared<cv_bridge::CvImage>(image->header, sensor_msgs::image_encodings::MONO8,
                                                greyImage(image).clone());
}

/// For the message about a wrong topic.
std::string imageTopics(const rosbag::Bag& bag) {
  std::set<std::string> topics;
  for (const rosbag::ConnectionInfo* connection : rosbag::View(bag).getConnections()) {
    if (connection->datatype == "sensor_msgs/Image" ||
        connection->datatype == "sensor_msgs/CompressedImage") {
      topics.insert(connection->topic);
    }
  }
  std::string text;
  for (const std::string& topic : topics) text += " " + topic;
  return text.empty() ? " none" : text;
}

std::optional<Eigen::Matrix3d> truthOf(const std::map<ros::Time, HomographyStamped>& truth,
                                       const ros::Time& previous, const ros::Time& stamp) {
  const auto entry = truth.find(stamp);
  if (entry == truth.end() || entry->second.reference_stamp != previous) return std::nullopt;
  using RowMajor = Eigen::Matrix<double, 3, 3, Eigen::RowMajor>;
  return Eigen::Matrix3d(Eigen::Map<const RowMajor>(entry->second.homography.data()));
}

}  // namespace

void readBag(const std::string& file, const std::string& topic, const std::string& truth_topic,
             const FrameVisitor& visit) {
  try {
    // librosbag, which also reads the truth, cannot handle all damage.
    const std::string damage = damageOf(file);
    if (!damage.empty()) throw FileError(file, "is damaged: " + damage);
    const rosbag::Bag bag(file, rosbag::bagmode::Read);
    const auto truth = readTruth(bag, truth_topic);
    ros::Time previous;
    bool any = false;
    for (const rosbag::MessageInstance& message : rosbag::View(bag, rosbag::TopicQuery(topic))) {
      const cv_bridge::CvImageConstPtr image = toGrey(message);
      if (!image) continue;
      const ros::Time& stamp = image->header.stamp;
      visit(stamp.toSec(), image->image, truthOf(truth, previous, stamp));
      previous = stamp;
      any = true;
    }
    if (!any) {
      throw FileError(file,
                      "has no images on " + topic + "; image topics in it:" + imageTopics(bag));
    }
  } catch (const rosbag::BagException& error) {
    throw FileError(file, std::string("cannot be read as a bag (") + error.what() + ")");
  } catch (const UnusableBag& error) {
    throw FileError(file, std::string("cannot be read as a bag (") + error.what() + ")");
  } catch (const RefusedImage& error) {
    throw FileError(file, "has an image on " + topic + " that cannot be used: " + error.what());
  } catch (const cv_bridge::Exception& error) {
    throw FileError(file,
                    "has an image on " + topic + " that cannot be used (" + error.what() + ")");
  }
}

}  // namespace ktgp_orb::tools
