#pragma once

#include <Eigen/Core>
#include <functional>
#include <opencv2/core.hpp>
#include <optional>
#include <string>

namespace ktgp_orb::evaluation {

/// Called for every image of a bag: its stamp in s, the image as 8-bit grey and, if the bag has it,
/// the true homography from the previous image.
using FrameVisitor = std::function<void(double stamp, const cv::Mat& image,
                                        const std::optional<Eigen::Matrix3d>& truth)>;

/// Reads the images (sensor_msgs/Image or CompressedImage) on `topic` in the order of the bag, and
/// the truth (ktgp_orb/HomographyStamped) on `truth_topic`. Returns the problems of a damaged bag,
/// whose readable part is used. Throws UnusableBag if the bag has no image on `topic`, and
/// FileError for an image that cannot be used.
std::string readBag(const std::string& file, const std::string& topic,
                    const std::string& truth_topic, const FrameVisitor& visit);

}  // namespace ktgp_orb::evaluation
