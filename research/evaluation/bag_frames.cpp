#include "evaluation/bag_frames.h"

#include <ktgp_orb/HomographyStamped.h>

#include <map>

#include "bag/reader.h"
#include "files/input.h"
#include "ros/image_conversion.h"
#include "ros/message_conversion.h"

namespace ktgp_orb::evaluation {
namespace {

/// The true homographies by the stamp of their target image.
std::map<ros::Time, HomographyStamped> readTruth(const std::string& file, const std::string& name) {
  BagMessages messages(file);
  messages.select([&](const bag::Topic& topic) { return topic.name == bag::topicName(name); });
  std::map<ros::Time, HomographyStamped> truth;
  while (const auto message = messages.next()) {
    const auto homography = message->as<HomographyStamped>();
    if (homography) truth[homography->header.stamp] = *homography;
  }
  return truth;
}

std::optional<Eigen::Matrix3d> truthOf(const std::map<ros::Time, HomographyStamped>& truth,
                                       const ros::Time& previous, const ros::Time& stamp) {
  const auto entry = truth.find(stamp);
  if (entry == truth.end() || entry->second.reference_stamp != previous) return std::nullopt;
  return homographyOf(entry->second);
}

}  // namespace

std::string readBag(const std::string& file, const std::string& topic,
                    const std::string& truth_topic, const FrameVisitor& visit) {
  try {
    const auto truth = readTruth(file, truth_topic);
    const auto images = openBag(file, {topic});
    ros::Time previous;
    while (const auto recorded = images->next()) {
      if (!recorded->image) throw RefusedImage(recorded->problem);
      const ros::Time& stamp = recorded->image->header.stamp;
      visit(stamp.toSec(), greyImage(recorded->image).clone(), truthOf(truth, previous, stamp));
      previous = stamp;
    }
    return images->damage();
  } catch (const RefusedImage& error) {
    throw files::FileError(file,
                           "has an image on " + topic + " that cannot be used: " + error.what());
  }
}

}  // namespace ktgp_orb::evaluation
