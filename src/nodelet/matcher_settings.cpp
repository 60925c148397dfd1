#include "nodelet/matcher_settings.h"

#include <ros/serialization.h>

#include <algorithm>
#include <stdexcept>
#include <system_error>

#include "ros/camera.h"
#include "ros/image_conversion.h"

namespace ktgp_orb {

MatcherSettings::FileState MatcherSettings::stateOf(const std::string& path) {
  std::error_code error;
  const auto time = std::filesystem::last_write_time(path, error);
  if (error) return {};
  const std::uintmax_t size = std::filesystem::file_size(path, error);
  if (error) return {};
  return {size, time};
}

/// Returns the frame of a large reference image. Extracting its features takes up to a second, so
/// we do it here, in the settings thread, while the worker goes on with the stream. Returns null if
/// the reference is small or not used.
FramePtr MatcherSettings::preparedReference(const Configuration& wanted,
                                            const Configuration& before) {
  // px; extracting the features of a smaller image takes less than 33 ms, the time between two
  // images.
  constexpr std::uint64_t kLarge = 1'000'000;
  const sensor_msgs::ImageConstPtr& image = wanted.reference_image;
  const bool is_used = wanted.sequence.reference.mode == ReferenceMode::fixed;
  if (!image || !is_used || std::uint64_t{image->width} * image->height < kLarge) return nullptr;
  const OrbOptions orb = withImages(wanted.sequence).orb;
  const bool is_same = image == before.reference_image && wanted.stretch == before.stretch;
  if (is_same && before.reference_frame && before.reference_frame->orb == orb) {
    return before.reference_frame;
  }
  OrbExtractor extractor(orb);
  return makeFrame(image, extractor, wanted.stretch);
}

/// Returns the reference with a stamp of its own if it has none, as an image from a file. The
/// consumers of the homographies tell images by their stamps. The first one keeps the stamp 0, as
/// in ktgp_bag.
sensor_msgs::ImageConstPtr MatcherSettings::stamped(const sensor_msgs::ImageConstPtr& image) {
  if (!image || !image->header.stamp.isZero()) return image;
  const auto with_stamp = boost::make_shared<sensor_msgs::Image>(*image);
  with_stamp->header.stamp.fromNSec(unstamped_++);
  return with_stamp;
}

sensor_msgs::ImageConstPtr MatcherSettings::readReference(const std::string& path) {
  return stamped(readImageFile("reference_image", path));
}

void MatcherSettings::configure(const KtgpConfig& config, const std::string& image_topic) {
  Configuration wanted = configurationFrom(config, configuration_.number);
  const bool are_rectified = pixelsFrom(config.calibration, image_topic) == Pixels::rectified;
  if (config.rectify && are_rectified) {
    throw std::invalid_argument("rectify is on, but the images on " + image_topic +
                                " are rectified already (see the parameter calibration)");
  }
  // If the file name is unchanged, keep the reference, even if it came from ~reference.
  const bool same_image = is_configured_ && config.reference_image == reference_file_;
  const FileState state = same_image ? file_state_ : stateOf(config.reference_image);
  const auto file = same_image ? file_reference_ : readReference(config.reference_image);
  wanted.reference_image = same_image ? configuration_.reference_image : file;
  const bool same_mask = is_configured_ && config.mask_image == mask_file_;
  wanted.view.file_mask =
      same_mask ? configuration_.view.file_mask : readMaskFile(config.mask_image);
  wanted.view.sent_mask = configuration_.view.sent_mask;
  wanted.view.lens = config.rectify ? lens_ : nullptr;
  wanted.lens_problem = configuration_.lens_problem;
  wanted.camera_problem = configuration_.camera_problem;
  wanted.view.pixels = are_rectified ? Pixels::rectified : Pixels::raw;
  wanted.view.camera =
      wanted.sequence.matcher.geometry == GeometryModel::homography ? nullptr : camera_;
  wanted.sequence.views_in_background = true;
  wanted.reference_frame = preparedReference(wanted, configuration_);
  if (is_configured_) ++wanted.number;
  configuration_ = std::move(wanted);  // no statement from here on throws
  reference_file_ = config.reference_image;
  mask_file_ = config.mask_image;
  file_reference_ = file;
  file_state_ = file_seen_ = state;
  is_configured_ = true;
}

// A camera_info arrives with every image and rarely changes, so we ignore a message that equals the
// previous message.
bool MatcherSettings::setLens(const sensor_msgs::CameraInfo& info, std::string& problem) {
  LensConstPtr lens;
  try {
    lens = lensFrom(info);
  } catch (const std::exception& error) {
    problem = error.what();
  }
  const bool same = lens && lens_ && lens->calibration() == lens_->calibration();
  if (problem == configuration_.lens_problem && (same || lens == lens_)) return false;
  if (!same) lens_ = lens;
  configuration_.view.lens = configuration_.rectify ? lens_ : nullptr;
  configuration_.lens_problem = problem;
  ++configuration_.number;
  return true;
}

bool MatcherSettings::setCamera(const sensor_msgs::CameraInfoConstPtr& info, std::string& problem) {
  if (configuration_.sequence.matcher.geometry == GeometryModel::homography) return false;
  const auto content = [](sensor_msgs::CameraInfo i) {
    i.header = std_msgs::Header();
    return ros::serialization::serializeMessage(i);
  };
  // Bytes are compared, because NaN differs from itself.
  const auto are_same = [](const ros::SerializedMessage& a, const ros::SerializedMessage& b) {
    return a.num_bytes == b.num_bytes &&
           std::equal(a.buf.get(), a.buf.get() + a.num_bytes, b.buf.get());
  };
  if (camera_ && configuration_.view.camera && are_same(content(*camera_), content(*info))) {
    return false;
  }
  try {
    twoViewCamera(*info, configuration_.view.pixels, imageSize(*info));
  } catch (const std::exception& error) {
    problem = error.what();
  }
  configuration_.camera_problem = problem;
  camera_ = configuration_.view.camera = info;
  ++configuration_.number;
  return true;
}

void MatcherSettings::setMask(const sensor_msgs::ImageConstPtr& image) {
  requireSmall("it", *image);
  const cv::Mat mask = maskFrom(image);
  if (hidesAll(mask)) throw RefusedImage("it " + std::string(kHidesAll));
  configuration_.view.sent_mask = mask;
  ++configuration_.number;
}

void MatcherSettings::setReference(const sensor_msgs::ImageConstPtr& image) {
  requireSmall("it", *image);
  const bool none = image->width == 0 || image->height == 0;
  if (!none) greyImage(image, configuration_.stretch);  // only a check: throws for a bad image
  useReference(none ? file_reference_ : stamped(image));
  ++configuration_.number;
}

void MatcherSettings::useReference(const sensor_msgs::ImageConstPtr& image) {
  Configuration wanted = configuration_;
  wanted.reference_image = image;
  wanted.reference_frame = preparedReference(wanted, configuration_);
  configuration_ = std::move(wanted);
}

bool MatcherSettings::rereadReference(bool at_once) {
  if (reference_file_.empty()) return false;
  const FileState now = stateOf(reference_file_);
  const bool settled = at_once || now == file_seen_;
  file_seen_ = now;
  if (now == file_state_ || !settled) return false;
  file_state_ = now;
  const auto before = std::exchange(file_reference_, readReference(reference_file_));
  // Keep a reference that came from ~reference.
  if (configuration_.reference_image == before) useReference(file_reference_);
  ++configuration_.number;
  return true;
}

}  // namespace ktgp_orb
