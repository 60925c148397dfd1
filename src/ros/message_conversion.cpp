#include "ros/message_conversion.h"

#include <cv_bridge/cv_bridge.h>

#include <algorithm>
#include <boost/make_shared.hpp>
#include <cmath>
#include <limits>
#include <utility>

#include "ktgp_orb/metrics.h"
#include "ros/answer_message.h"
#include "ros/image_conversion.h"
#include "util/format.h"
#include "util/keypoint_position.h"
#include "util/names.h"

namespace ktgp_orb {
namespace {

// The constants of the messages and the enumerators of the core have the same numbers.
static_assert(int(Status::ok) == MatchStatus::STATUS_OK, "");
static_assert(int(Status::no_reference) == MatchStatus::STATUS_NO_REFERENCE, "");
static_assert(int(Status::too_few_features) == MatchStatus::STATUS_TOO_FEW_FEATURES, "");
static_assert(int(Status::too_few_matches) == MatchStatus::STATUS_TOO_FEW_MATCHES, "");
static_assert(int(Status::no_model) == MatchStatus::STATUS_NO_MODEL, "");
static_assert(int(Status::model_rejected) == MatchStatus::STATUS_MODEL_REJECTED, "");
static_assert(int(NoReference::none) == MatchStatus::REASON_NONE, "");
static_assert(int(NoReference::first_frame) == MatchStatus::REASON_FIRST_FRAME, "");
static_assert(int(NoReference::gap) == MatchStatus::REASON_GAP, "");
static_assert(int(NoReference::stamp_went_back) == MatchStatus::REASON_STAMP_WENT_BACK, "");
static_assert(int(NoReference::size_changed) == MatchStatus::REASON_SIZE_CHANGED, "");
static_assert(int(NoReference::encoding_changed) == MatchStatus::REASON_ENCODING_CHANGED, "");
static_assert(int(NoReference::not_set) == MatchStatus::REASON_NOT_SET, "");
static_assert(int(NoReference::reset) == MatchStatus::REASON_RESET, "");
static_assert(int(NoReference::mode_changed) == MatchStatus::REASON_MODE_CHANGED, "");
static_assert(int(NoReference::lens_changed) == MatchStatus::REASON_LENS_CHANGED, "");
static_assert(int(Search::whole) == MatchStatistics::SEARCH_WHOLE_IMAGE, "");
static_assert(int(Search::near) == MatchStatistics::SEARCH_NEAR, "");
static_assert(int(Search::fell_back) == MatchStatistics::SEARCH_FELL_BACK, "");
static_assert(int(Level::kt) == Correspondences::LEVEL_KT, "");
static_assert(int(Level::ktg) == Correspondences::LEVEL_KTG, "");
static_assert(int(Level::ktgp) == Correspondences::LEVEL_KTGP, "");
static_assert(int(Level::guided) == Correspondences::LEVEL_GUIDED, "");
static_assert(int(AlignmentStatus::ok) == MatchStatistics::ALIGNMENT_OK, "");
static_assert(int(AlignmentStatus::no_images) == MatchStatistics::ALIGNMENT_NO_IMAGES, "");
static_assert(int(AlignmentStatus::too_few_points) == MatchStatistics::ALIGNMENT_TOO_FEW_POINTS,
              "");
static_assert(int(AlignmentStatus::not_better) == MatchStatistics::ALIGNMENT_NOT_BETTER, "");

void append(const Correspondence& c, const Frame& reference, const Frame& target,
            Correspondences& message) {
  const cv::Point2f from = util::imagePoint(reference.features, c.reference_index);
  const cv::Point2f to = util::imagePoint(target.features, c.target_index);
  message.reference_x.push_back(from.x);
  message.reference_y.push_back(from.y);
  message.target_x.push_back(to.x);
  message.target_y.push_back(to.y);
  message.distance.push_back(static_cast<std::uint16_t>(c.distance));
  message.ratio.push_back(static_cast<float>(c.ratio()));
  message.reference_index.push_back(static_cast<std::uint32_t>(c.reference_index));
  message.target_index.push_back(static_cast<std::uint32_t>(c.target_index));
  message.level.push_back(static_cast<std::uint8_t>(c.level));
  message.track.push_back(target.tracks[static_cast<std::size_t>(c.target_index)]);
}

/// Sets the image sizes in a Correspondences or HomographyStamped message.
template <typename Message>
void setSizes(const cv::Size& image, const cv::Size& reference, Message& message) {
  message.image_width = static_cast<std::uint32_t>(image.width);
  message.image_height = static_cast<std::uint32_t>(image.height);
  message.reference_width = static_cast<std::uint32_t>(reference.width);
  message.reference_height = static_cast<std::uint32_t>(reference.height);
}

template <typename Message>
void setSizes(const SequenceMatch& match, Message& message) {
  setSizes(match.frame->features.image_size,
           match.reference ? match.reference->features.image_size : cv::Size(), message);
}

void reserve(std::size_t size, Correspondences& message) {
  message.reference_x.reserve(size);
  message.reference_y.reserve(size);
  message.target_x.reserve(size);
  message.target_y.reserve(size);
  message.distance.reserve(size);
  message.ratio.reserve(size);
  message.reference_index.reserve(size);
  message.target_index.reserve(size);
  message.level.reserve(size);
  message.track.reserve(size);
}

/// Index of the correspondence in the message that belongs to the aligned point. Empty for a guided
/// match that disagrees with the aligned homography, because the message does not contain it.
/// `guided`: index of the first guided match. The matches before this index and the guided matches
/// are each sorted by target_index.
std::optional<std::uint32_t> placeOf(const AlignedPoint& point, std::size_t guided,
                                     const Correspondences& message) {
  const auto target = static_cast<std::uint32_t>(point.target_index);
  const auto& targets = message.target_index;
  const auto middle = targets.begin() + static_cast<std::ptrdiff_t>(guided);
  for (const auto& [first, last] :
       {std::pair(targets.begin(), middle), std::pair(middle, targets.end())}) {
    const auto found = std::lower_bound(first, last, target);
    if (found == last || *found != target) continue;
    const auto place = static_cast<std::size_t>(found - targets.begin());
    if (message.reference_index[place] == static_cast<std::uint32_t>(point.reference_index)) {
      return static_cast<std::uint32_t>(place);
    }
  }
  return std::nullopt;
}

void appendAligned(const AlignmentResult& alignment, std::size_t guided, Correspondences& message) {
  if (alignment.status != AlignmentStatus::ok) return;
  for (const AlignedPoint& p : alignment.points) {
    const std::optional<std::uint32_t> place = placeOf(p, guided, message);
    if (!place) continue;
    message.aligned.push_back(*place);
    message.aligned_reference_x.push_back(static_cast<float>(p.reference.x()));
    message.aligned_reference_y.push_back(static_cast<float>(p.reference.y()));
    message.aligned_target_x.push_back(static_cast<float>(p.target.x()));
    message.aligned_target_y.push_back(static_cast<float>(p.target.y()));
  }
}

void append(const StageResult& stage, MatchStatistics& message) {
  message.stages.emplace_back();
  StageStatistics& out = message.stages.back();
  out.name = toString(stage.id);
  out.input = static_cast<std::uint32_t>(stage.input);
  out.output = static_cast<std::uint32_t>(stage.output);
  out.milliseconds = stage.milliseconds;
}

void setStages(const MatchResult& result, MatchStatistics& message) {
  for (const StageResult& stage : result.stages) append(stage, message);
  message.alignment_status = static_cast<std::uint8_t>(result.alignment.status);
  message.alignment_rmse_before = result.alignment.rmse_before;
  message.alignment_rmse_after = result.alignment.rmse_after;
  const StageResult& tf = *result.stage(StageId::tf);
  message.kt = static_cast<std::uint32_t>(tf.output);
  message.ktg = static_cast<std::uint32_t>(result.stage(StageId::gms)->output);
  message.inliers = static_cast<std::uint32_t>(result.inliers);
  if (tf.input > 0) {
    message.retention = static_cast<double>(tf.output) / static_cast<double>(tf.input);
  }
}

}  // namespace

std::int64_t stampOf(const ros::Time& time) {
  return static_cast<std::int64_t>(time.toNSec());
}

ros::Time timeOf(std::int64_t nanoseconds) {
  ros::Time time;
  time.fromNSec(static_cast<std::uint64_t>(nanoseconds));
  return time;
}

/// Makes a message with all correspondences that passed the ratio test. `level` is the last filter
/// that a correspondence passed.
CorrespondencesPtr toCorrespondences(const MatchedFrame& frame) {
  const SequenceMatch& match = frame.match;
  if (!match.reference) return nullptr;
  const Frame& reference = *match.reference;
  const Frame& target = *match.frame;
  auto message = boost::make_shared<Correspondences>();
  message->header = frame.header;
  message->reference_stamp = timeOf(reference.stamp);
  setSizes(match, *message);
  message->geometry = static_cast<std::uint8_t>(match.match.geometry);
  message->rectified = frame.isRectified();
  const std::vector<Correspondence>& guided = match.match.guided;
  reserve(countAtLeast(match.match.correspondences, Level::kt) + guided.size(), *message);
  for (const auto* list : {&match.match.correspondences, &guided}) {
    for (const Correspondence& c : *list) {
      if (c.level >= Level::kt) append(c, reference, target, *message);
    }
  }
  appendAligned(match.match.alignment, message->level.size() - guided.size(), *message);
  return message;
}

/// Makes a message with the homography. If no homography was found, its numbers are all zero.
HomographyStampedPtr toHomography(const MatchedFrame& frame) {
  const SequenceMatch& match = frame.match;
  const MatchResult& result = match.match;
  auto message = boost::make_shared<HomographyStamped>();
  message->header = frame.header;
  if (match.reference) message->reference_stamp = timeOf(match.reference->stamp);
  message->status = static_cast<std::uint8_t>(result.homographyStatus());
  message->reason = static_cast<std::uint8_t>(match.no_reference);
  if (result.geometry == Geometry::epipolar) message->reason = MatchStatus::REASON_NO_PLANE;
  message->rectified = frame.isRectified();
  setSizes(match, *message);
  if (result.homographyStatus() != Status::ok) return message;
  message->inliers = static_cast<std::uint32_t>(result.inliers);
  message->reprojection_rmse = result.rmse;
  copyAnswer(result.answer, *message);
  return message;
}

HomographyStampedPtr toAccumulated(const MatchedFrame& frame) {
  const SequenceMatch& match = frame.match;
  if (!match.reference || !match.accumulated) return nullptr;
  auto message = boost::make_shared<HomographyStamped>();
  message->header = frame.header;
  message->reference_stamp = timeOf(match.first_stamp);
  message->status = MatchStatus::STATUS_OK;
  message->rectified = frame.isRectified();
  const cv::Size& size = match.frame->features.image_size;
  setSizes(size, size, *message);  // the image size never changes within an unbroken sequence
  message->inliers = static_cast<std::uint32_t>(match.match.inliers);
  message->reprojection_rmse = match.match.rmse;
  copyAnswer(*match.accumulated, *message);
  return message;
}

MatchStatisticsPtr toStatistics(const MatchedFrame& frame) {
  const SequenceMatch& match = frame.match;
  auto message = boost::make_shared<MatchStatistics>();
  message->header = frame.header;
  message->configuration = frame.configuration;
  message->latency_milliseconds = 1e3 * frame.latency;
  message->dropped_frames = frame.dropped;
  message->lost_frames = frame.lost;
  message->skipped_frames = frame.skipped;
  message->refused_frames = frame.refused;
  message->repeated_frames = frame.repeated;
  message->status = static_cast<std::uint8_t>(match.match.status);
  message->geometry = static_cast<std::uint8_t>(match.match.geometry);
  message->reason = static_cast<std::uint8_t>(match.no_reference);
  message->reference_changed = match.reference_changed;
  message->search = static_cast<std::uint8_t>(match.match.search);
  message->fall_backs = match.fall_backs;
  message->found_by = static_cast<std::uint8_t>(match.match.found_by);
  message->growth_seeds = static_cast<std::uint32_t>(match.match.growth.seeds);
  message->descriptor = toString(match.frame->features.descriptor);
  message->target_features = static_cast<std::uint32_t>(match.frame->features.size());
  message->extraction_milliseconds = match.frame->extraction_milliseconds;
  message->total_milliseconds = match.total_milliseconds;
  setStages(match.match, *message);
  if (!match.reference) return message;

  message->reference_stamp = timeOf(match.reference->stamp);
  message->reference_features = static_cast<std::uint32_t>(match.reference->features.size());
  const auto distance = metrics::descriptorDistance(match.match.correspondences, Level::ktgp);
  message->mean_distance = distance.mean;
  message->rms_distance = distance.rms;
  if (match.match.status == Status::ok) {
    message->reprojection_rmse = match.match.rmse;
    homography::visitNumbers(CopyField(), match.match.answer, *message);
  }
  return message;
}

MatchPtr toMatch(const MatchedFrame& frame) {
  auto match = boost::make_shared<Match>();
  match->header = frame.header;
  match->statistics = *toStatistics(frame);
  match->homography = *toHomography(frame);
  match->correspondences.header = frame.header;
  setSizes(frame.match, match->correspondences);
  if (const auto correspondences = toCorrespondences(frame)) {
    match->correspondences = std::move(*correspondences);
  }
  return match;
}

FrameMessages toMessages(const MatchedFrame& frame) {
  FrameMessages messages;
#define KTGP_TOPIC(name, Message, make, text) messages.name = make(frame);
#define KTGP_LIVE_TOPIC(name, Message, make, text)
#include "ros/topics.def"
#undef KTGP_TOPIC
#undef KTGP_LIVE_TOPIC
  return messages;
}

HomographyStampedPtr toHomography(const std_msgs::Header& header, const ros::Time& reference,
                                  const std::optional<Eigen::Matrix3d>& homography,
                                  const cv::Size& image, const cv::Size& reference_size) {
  auto message = boost::make_shared<HomographyStamped>();
  message->header = header;
  setSizes(image, reference_size, *message);
  message->reference_stamp = reference;
  message->status = homography ? MatchStatus::STATUS_OK : MatchStatus::STATUS_NO_MODEL;
  if (!homography) return message;
  const double not_known = std::numeric_limits<double>::quiet_NaN();
  copyAnswer({*homography, Covariance8::Constant(not_known)}, *message);
  return message;
}

std::optional<Eigen::Matrix3d> homographyOf(const HomographyStamped& message) {
  const std::optional<UncertainHomography> answer = answerOf(message);
  return answer ? std::make_optional(answer->homography) : std::nullopt;
}

std::optional<Eigen::Matrix3d> homographyOf(const HomographyStamped& message,
                                            const cv::Size& size) {
  std::optional<Eigen::Matrix3d> answer = homographyOf(message);
  const cv::Size image(static_cast<int>(message.image_width),
                       static_cast<int>(message.image_height));
  if (image.empty() || image == size) return answer;
  const double scale = static_cast<double>(size.width) / image.width;
  // Resizing rounds the height to whole pixels, so allow an error of one pixel of the smaller
  // image.
  if (std::abs(scale * image.height - size.height) > std::max(1.0, scale)) {
    throw RefusedImage("the homographies are of images of " + util::text(image) +
                       " and cannot be scaled to those of " + util::text(size) +
                       "; expected the same image, or one that is resized");
  }
  if (!answer) return answer;
  const Eigen::Matrix3d larger = homography::resizing(image, size);
  const bool is_of_camera = message.reference_width == message.image_width &&
                            message.reference_height == message.image_height;
  if (!is_of_camera) return larger * *answer;
  return larger * *answer * larger.inverse();
}

sensor_msgs::ImagePtr toImage(const std_msgs::Header& header, const std::string& encoding,
                              const cv::Mat& pixels) {
  return cv_bridge::CvImage(header, encoding, pixels).toImageMsg();
}

const char* explanation(NoReference reason) {
  return util::nameOf<NoReference::lens_changed>(
      reason, {"matched", "the first frame", "the previous frame is older than max_reference_age",
               "the stamp went back", "the image size changed", "the encoding changed",
               "fixed mode without reference_image or set_reference", "the matcher was reset",
               "reference_mode changed", "another lens calibration"});
}

namespace {

/// The image that the frame's keypoints refer to: it is rectified if the frame has a lens.
cv::Mat shown(const cv::Mat& image, const LensConstPtr& lens) {
  if (!lens) return image;
  cv::Mat rectified;
  lens->rectify(image, rectified);
  return rectified;
}

/// The target image for drawing: in colour if it has 8 bits per channel, otherwise the grey image
/// of the frame.
cv::Mat coloured(const sensor_msgs::ImageConstPtr& image, const Frame& frame) {
  return shown(hasBytes(image->encoding) ? colourImage(image) : frame.image, frame.lens);
}

}  // namespace

sensor_msgs::ImagePtr toOverlay(const sensor_msgs::ImageConstPtr& image, const SequenceMatch& match,
                                OverlayStyle style) {
  cv::Mat canvas;
  const cv::Mat target = coloured(image, *match.frame);
  if (!match.reference) {
    drawUnmatched(target, std::string("no reference: ") + explanation(match.no_reference), canvas);
  } else {
    const Frame& reference = *match.reference;
    drawOverlay({shown(reference.image, reference.lens), reference.features},
                {target, match.frame->features}, match.match, style, canvas);
  }
  return toImage(image->header, "bgr8", canvas);
}

}  // namespace ktgp_orb
