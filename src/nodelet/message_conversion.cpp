#include "nodelet/message_conversion.h"

#include <boost/make_shared.hpp>
#include <cmath>

#include "ktgp_orb/overlay.h"

namespace ktgp_orb {
namespace {

// The messages' constants and the core's enumerators are one numbering.
static_assert(int(Status::ok) == MatchStatistics::STATUS_OK, "");
static_assert(int(Status::no_reference) == MatchStatistics::STATUS_NO_REFERENCE, "");
static_assert(int(Status::too_few_features) == MatchStatistics::STATUS_TOO_FEW_FEATURES, "");
static_assert(int(Status::too_few_matches) == MatchStatistics::STATUS_TOO_FEW_MATCHES, "");
static_assert(int(Status::no_model) == MatchStatistics::STATUS_NO_MODEL, "");
static_assert(int(Status::model_rejected) == MatchStatistics::STATUS_MODEL_REJECTED, "");
static_assert(int(Status::ok) == HomographyStamped::STATUS_OK, "");
static_assert(int(Status::no_reference) == HomographyStamped::STATUS_NO_REFERENCE, "");
static_assert(int(Status::too_few_features) == HomographyStamped::STATUS_TOO_FEW_FEATURES, "");
static_assert(int(Status::too_few_matches) == HomographyStamped::STATUS_TOO_FEW_MATCHES, "");
static_assert(int(Status::no_model) == HomographyStamped::STATUS_NO_MODEL, "");
static_assert(int(Status::model_rejected) == HomographyStamped::STATUS_MODEL_REJECTED, "");
static_assert(int(Level::kt) == Correspondences::LEVEL_KT, "");
static_assert(int(Level::ktg) == Correspondences::LEVEL_KTG, "");
static_assert(int(Level::ktgp) == Correspondences::LEVEL_KTGP, "");

const cv::Point2f& position(const Frame& frame, std::int32_t index) {
  return frame.features.keypoints[static_cast<std::size_t>(index)].pt;
}

void append(const Correspondence& c, const cv::Point2f& reference, const cv::Point2f& target,
            Correspondences& message) {
  message.reference_x.push_back(reference.x);
  message.reference_y.push_back(reference.y);
  message.target_x.push_back(target.x);
  message.target_y.push_back(target.y);
  message.distance.push_back(static_cast<std::uint16_t>(c.distance));
  message.ratio.push_back(static_cast<float>(c.ratio()));
  message.reference_index.push_back(static_cast<std::uint32_t>(c.reference_index));
  message.target_index.push_back(static_cast<std::uint32_t>(c.target_index));
  message.level.push_back(static_cast<std::uint8_t>(c.level));
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
}

/// Mean and root mean square of the final matches' Hamming distances.
void setDistances(const MatchResult& result, MatchStatistics& message) {
  double sum = 0.0;
  double squares = 0.0;
  double count = 0.0;
  for (const Correspondence& c : result.correspondences) {
    if (c.level < Level::ktgp) continue;
    sum += c.distance;
    squares += static_cast<double>(c.distance) * c.distance;
    ++count;
  }
  if (count == 0.0) return;
  message.mean_distance = sum / count;
  message.rms_distance = std::sqrt(squares / count);
}

}  // namespace

CorrespondencesPtr toCorrespondences(const Frame& reference, const Frame& target,
                                     const MatchResult& result) {
  auto message = boost::make_shared<Correspondences>();
  message->header = target.message->header;
  message->reference_stamp = reference.message->header.stamp;
  message->image_width = static_cast<std::uint32_t>(target.grey.cols);
  message->image_height = static_cast<std::uint32_t>(target.grey.rows);
  message->reference_width = static_cast<std::uint32_t>(reference.grey.cols);
  message->reference_height = static_cast<std::uint32_t>(reference.grey.rows);
  reserve(countAtLeast(result.correspondences, Level::kt), *message);
  for (const Correspondence& c : result.correspondences) {
    if (c.level < Level::kt) continue;
    append(c, position(reference, c.reference_index), position(target, c.target_index), *message);
  }
  return message;
}

void copyHomography(const Eigen::Matrix3d& homography, HomographyStamped& message) {
  Eigen::Map<Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(message.homography.data()) = homography;
}

HomographyStampedPtr toHomography(const Frame& reference, const Frame& target,
                                  const MatchResult& result) {
  auto message = boost::make_shared<HomographyStamped>();
  message->header = target.message->header;
  message->reference_stamp = reference.message->header.stamp;
  message->status = static_cast<std::uint8_t>(result.status);
  if (result.status != Status::ok) return message;
  copyHomography(result.prosac.homography, *message);
  message->inliers = static_cast<std::uint32_t>(result.prosac.inliers);
  message->reprojection_rmse = result.prosac.rmse;
  Eigen::Map<Eigen::Matrix<double, 8, 8, Eigen::RowMajor>>(message->covariance.data()) =
      result.prosac.covariance;
  return message;
}

MatchStatisticsPtr toStatistics(const Frame* reference, const Frame& target,
                                const MatchResult* result) {
  auto message = boost::make_shared<MatchStatistics>();
  message->header = target.message->header;
  message->status = MatchStatistics::STATUS_NO_REFERENCE;
  message->target_features = static_cast<std::uint32_t>(target.features.size());
  message->extraction_milliseconds = target.extraction_milliseconds;
  message->total_milliseconds = target.extraction_milliseconds;
  if (reference == nullptr || result == nullptr) return message;

  message->reference_stamp = reference->message->header.stamp;
  message->reference_features = static_cast<std::uint32_t>(reference->features.size());
  message->status = static_cast<std::uint8_t>(result->status);
  for (const StageResult& stage : result->stages) {
    message->stages.emplace_back();
    StageStatistics& out = message->stages.back();
    out.name = stage.name;
    out.input = static_cast<std::uint32_t>(stage.input);
    out.output = static_cast<std::uint32_t>(stage.output);
    out.milliseconds = stage.milliseconds;
    message->total_milliseconds += stage.milliseconds;
  }
  const auto& tf = result->stages[1];
  if (tf.input > 0)
    message->retention = static_cast<double>(tf.output) / static_cast<double>(tf.input);
  setDistances(*result, *message);
  if (result->status == Status::ok) message->reprojection_rmse = result->prosac.rmse;
  return message;
}

sensor_msgs::ImagePtr toOverlay(const Frame& reference, const Frame& target,
                                const MatchResult& result) {
  auto message = boost::make_shared<sensor_msgs::Image>();
  cv::Mat canvas;
  drawOverlay({reference.grey, reference.features}, {target.grey, target.features}, result,
              OverlayStyle::flow, canvas);
  message->header = target.message->header;
  message->encoding = "bgr8";
  message->height = static_cast<std::uint32_t>(canvas.rows);
  message->width = static_cast<std::uint32_t>(canvas.cols);
  message->step = static_cast<std::uint32_t>(canvas.cols * canvas.elemSize());
  message->data.assign(canvas.datastart, canvas.dataend);
  return message;
}

}  // namespace ktgp_orb
