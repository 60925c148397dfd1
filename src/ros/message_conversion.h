#pragma once

#include <ktgp_orb/Correspondences.h>
#include <ktgp_orb/HomographyStamped.h>
#include <ktgp_orb/Match.h>
#include <ktgp_orb/MatchStatistics.h>
#include <ktgp_orb/TwoViewGeometry.h>
#include <sensor_msgs/Image.h>
#include <sensor_msgs/PointCloud2.h>
#include <std_msgs/Header.h>

#include <Eigen/Core>
#include <boost/shared_ptr.hpp>
#include <cstdint>
#include <opencv2/core.hpp>
#include <optional>
#include <string>

#include "ktgp_orb/overlay.h"
#include "ktgp_orb/sequence_matcher.h"

namespace ktgp_orb {

/// A matched frame, with data that only the node knows. It refers to `match`, so it is valid as
/// long as `match` is.
struct MatchedFrame {
  std_msgs::Header header;  ///< header of the target image
  const SequenceMatch& match;
  std::uint32_t configuration = 0;  ///< number of the parameter set (Configuration::number)
  double latency = 0.0;             ///< s
  std::uint64_t dropped = 0;        ///< number of frames since the start, like the next four
  std::uint64_t lost = 0;
  std::uint64_t skipped = 0;
  std::uint64_t refused = 0;
  std::uint64_t repeated = 0;
  bool has_rectified_image = false;  ///< the image was already rectified when it arrived
  /// Returns true if the keypoints are pixels of an image without distortion.
  bool isRectified() const { return has_rectified_image || match.frame->lens != nullptr; }
};

/// Tells a user why a frame has no reference, such as "the previous frame is older than
/// max_reference_age".
const char* explanation(NoReference reason);

/// Functions that make the messages of topics.def. They return null if this frame has no such
/// message.
#define KTGP_TOPIC(name, Message, make, text) boost::shared_ptr<Message> make(const MatchedFrame&);
#define KTGP_LIVE_TOPIC KTGP_TOPIC
#include "ros/topics.def"
#undef KTGP_TOPIC
#undef KTGP_LIVE_TOPIC

/// All messages of one frame, to be written to a bag.
struct FrameMessages {
#define KTGP_TOPIC(name, Message, make, text) boost::shared_ptr<Message> name;
#define KTGP_LIVE_TOPIC(name, Message, make, text)
#include "ros/topics.def"
#undef KTGP_TOPIC
#undef KTGP_LIVE_TOPIC
  sensor_msgs::ImagePtr overlay;  ///< null if no overlay is wanted
};
/// Makes all messages of the frame except the overlay.
FrameMessages toMessages(const MatchedFrame& frame);

/// Makes a message for a homography whose inliers and covariance are unknown. If `homography` is
/// empty, the message says that none was found. `image`, `reference_size`: sizes of the target
/// image and of the reference, px; empty: unknown.
HomographyStampedPtr toHomography(const std_msgs::Header& header, const ros::Time& reference,
                                  const std::optional<Eigen::Matrix3d>& homography,
                                  const cv::Size& image, const cv::Size& reference_size);
/// The homography of the message; empty if no homography was found.
std::optional<Eigen::Matrix3d> homographyOf(const HomographyStamped& message);
/// Scales the homography of the message to images of `size`, px, if the matcher's images had a
/// different size. The reference side is scaled, too, but only if the reference had the same size
/// as the matcher's images. Throws RefusedImage if `size` and the size of the matcher's images have
/// different aspect ratios.
std::optional<Eigen::Matrix3d> homographyOf(const HomographyStamped& message, const cv::Size& size);

/// Converts a time to nanoseconds, the core's unit of time, and back.
std::int64_t stampOf(const ros::Time& time);
ros::Time timeOf(std::int64_t nanoseconds);

/// Makes an image message with a copy of the pixels.
sensor_msgs::ImagePtr toImage(const std_msgs::Header& header, const std::string& encoding,
                              const cv::Mat& pixels);

/// The overlay picture (bgr8) with the header of the target image. If there is no reference, a text
/// in the picture says why. `image`: the message with the target image, because the frame holds
/// only a grey image and the overlay is in colour.
sensor_msgs::ImagePtr toOverlay(const sensor_msgs::ImageConstPtr& image, const SequenceMatch& match,
                                OverlayStyle style);

}  // namespace ktgp_orb
