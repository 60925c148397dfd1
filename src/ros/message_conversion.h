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

/// A matched frame with the data that only its node knows. Valid as long as the match.
struct MatchedFrame {
  std_msgs::Header header;  ///< header of the target image
  const SequenceMatch& match;
  std::uint32_t configuration = 0;  ///< number of the configuration
  double latency = 0.0;             ///< s
  std::uint64_t dropped = 0;        ///< frames since the start
  std::uint64_t lost = 0;
  std::uint64_t skipped = 0;
  std::uint64_t refused = 0;
  std::uint64_t repeated = 0;
  bool has_rectified_image = false;  ///< before any lens of the frame
  /// Whether the points are those of an image without distortion.
  bool isRectified() const { return has_rectified_image || match.frame->lens != nullptr; }
};

/// The messages of the topics in topics.def; null if there is nothing to say.
#define KTGP_TOPIC(name, Message, make, text) boost::shared_ptr<Message> make(const MatchedFrame&);
#define KTGP_LIVE_TOPIC KTGP_TOPIC
#include "ros/topics.def"
#undef KTGP_TOPIC
#undef KTGP_LIVE_TOPIC

/// All messages of one frame, for a bag.
struct FrameMessages {
#define KTGP_TOPIC(name, Message, make, text) boost::shared_ptr<Message> name;
#define KTGP_LIVE_TOPIC(name, Message, make, text)
#include "ros/topics.def"
#undef KTGP_TOPIC
#undef KTGP_LIVE_TOPIC
  sensor_msgs::ImagePtr overlay;  ///< null unless wanted
};
/// All messages of the frame, without the overlay.
FrameMessages toMessages(const MatchedFrame& frame);

/// A homography without inliers; its covariance is not known. Empty: none was found. The sizes are
/// those of the two images, px; empty: not known.
HomographyStampedPtr toHomography(const std_msgs::Header& header, const ros::Time& reference,
                                  const std::optional<Eigen::Matrix3d>& homography,
                                  const cv::Size& image, const cv::Size& reference_size);
/// The homography of the message; empty if none was found.
std::optional<Eigen::Matrix3d> homographyOf(const HomographyStamped& message);
/// The same between images of `size`, px: where the matcher had the images in another size, it is
/// scaled. A reference that was never of the camera's size keeps its pixels. Throws RefusedImage
/// where the two sizes have another shape.
std::optional<Eigen::Matrix3d> homographyOf(const HomographyStamped& message, const cv::Size& size);

/// Nanoseconds, as in the core.
std::int64_t stampOf(const ros::Time& time);
ros::Time timeOf(std::int64_t nanoseconds);

/// A copy of the pixels as a message.
sensor_msgs::ImagePtr toImage(const std_msgs::Header& header, const std::string& encoding,
                              const cv::Mat& pixels);

/// The overlay picture (bgr8) with the header of the target; without a reference it shows the
/// reason. `image`: the message of the target, for its colours.
sensor_msgs::ImagePtr toOverlay(const sensor_msgs::ImageConstPtr& image, const SequenceMatch& match,
                                OverlayStyle style);

}  // namespace ktgp_orb
