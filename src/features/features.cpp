#include "ktgp_orb/features.h"

#include <algorithm>
#include <stdexcept>

#include "ktgp_orb/correspondence.h"
#include "ktgp_orb/status.h"
#include "util/format.h"
#include "util/keypoint_position.h"
#include "util/names.h"

namespace ktgp_orb {

const char* toString(DescriptorKind kind) {
  return kind == DescriptorKind::teblid ? "teblid" : "orb";
}

void requireSameDescriptor(const Features& reference, const Features& target) {
  if (reference.descriptor == target.descriptor) return;
  throw std::invalid_argument(std::string("reference has ") + toString(reference.descriptor) +
                              " descriptors and target " + toString(target.descriptor) +
                              "; expected the same kind in both");
}

void requireDescriptors(const cv::Mat& descriptors, const std::string& name) {
  if (descriptors.empty()) return;
  if (descriptors.type() != CV_8UC1 || descriptors.cols != kDescriptorBytes) {
    throw std::invalid_argument(name + " descriptors are " + cv::typeToString(descriptors.type()) +
                                " with " + std::to_string(descriptors.cols) +
                                " columns; expected CV_8UC1 with 32 columns (256 bits)");
  }
}

void requireImageSize(const Features& features, const std::string& name) {
  if (features.empty() || (features.image_size.width > 0 && features.image_size.height > 0)) return;
  throw std::invalid_argument(name + " has image size " + util::text(features.image_size) +
                              "; expected the width and height of its image in pixels");
}

void requireValid(const Features& features, const std::string& name) {
  requireDescriptors(features.descriptors, name);
  const auto rows = static_cast<std::size_t>(features.descriptors.rows);
  if (rows != features.size()) {
    throw std::invalid_argument(name + " has " + std::to_string(features.size()) +
                                " keypoints but " + std::to_string(rows) +
                                " descriptor rows; expected one row per keypoint");
  }
  requireImageSize(features, name);
}

void util::refuseKeypoint(const Features& features, std::int32_t index, const char* frame) {
  throw std::invalid_argument("match has " + std::string(frame) + " keypoint " +
                              std::to_string(index) + "; expected one of the frame's " +
                              std::to_string(features.size()) + ", counted from 0");
}

double Correspondence::ratio() const {
  return second_distance > 0 ? static_cast<double>(distance) / second_distance : 1.0;
}

std::size_t countAtLeast(const std::vector<Correspondence>& correspondences, Level level) {
  return static_cast<std::size_t>(
      std::count_if(correspondences.begin(), correspondences.end(),
                    [level](const Correspondence& c) { return c.level >= level; }));
}

const char* toString(Status status) {
  return util::nameOf<Status::model_rejected>(
      status,
      {"ok", "no_reference", "too_few_features", "too_few_matches", "no_model", "model_rejected"});
}

}  // namespace ktgp_orb
