#include "tools/bag_targets.h"

#include <ktgp_orb/MatchStatus.h>

#include <filesystem>
#include <iostream>

#include "bag/reader.h"
#include "bag/video.h"
#include "files/input.h"
#include "files/target_list.h"
#include "ros/image_conversion.h"
#include "tools/matcher_cli.h"
#include "util/camera_check.h"
#include "util/counted.h"

namespace ktgp_orb::tools {
namespace {

namespace fs = std::filesystem;

}  // namespace

std::optional<sensor_msgs::CameraInfo> cameraInfoOf(const std::string& recording,
                                                    const std::string& image_topic) {
  if (kindOf(recording) != InputKind::bag) return std::nullopt;
  try {
    return readCameraInfo(recording, image_topic, "--targets");
  } catch (const UnusableBag&) {
    return std::nullopt;
  }
}

void addTargetsArguments(CLI::App& app, TargetsInput& targets) {
  constexpr const char* kGroup = "Flat targets (see doc/targets.md)";
  CLI::Option* path =
      app.add_option("--targets", targets.path,
                     "also find flat targets: a folder with an image of each, or a YAML list; the "
                     "topic targets/detections of the output has where they are, and their poses")
          ->type_name("FILE")
          ->group(kGroup);
  tools::describe(app.add_option("--targets_readout_time", targets.readout_time), "targets")
      ->capture_default_str()
      ->needs(path)
      ->group(kGroup);
}

std::vector<std::string> filesOfTargets(const std::string& path) {
  std::vector<std::string> files;
  if (path.empty()) return files;
  if (!fs::is_directory(path)) files.push_back(path);
  for (const TargetEntry& entry : readTargetList(path)) {
    files.insert(files.end(), entry.files.begin(), entry.files.end());
  }
  return files;
}

BagTargets::BagTargets(const TargetsInput& input, const std::string& recording,
                       const std::string& image_topic,
                       const std::optional<sensor_msgs::CameraInfo>& camera)
    : input_(input), info_topic_(cameraOf(image_topic) + "/camera_info") {
  if (input_.path.empty()) return;
  util::requireReadoutTime(input_.readout_time);
  const auto refused = addTargets(readTargetList(input_.path), finder_);
  for (const std::string& reason : refused) std::cerr << "ktgp_bag: " << reason << '\n';
  refused_ = refused.size();
  if (finder_.ids().empty()) {
    throw files::FileError(input_.path, "holds no target that can be used");
  }
  pixels_ = pixelsFrom(input_.calibration, image_topic);
  info_ = camera ? camera : cameraInfoOf(recording, image_topic);
  pose_.setReadoutTime(input_.readout_time);
}

TargetDetectionsPtr BagTargets::find(const sensor_msgs::ImageConstPtr& image) {
  if (input_.path.empty()) return nullptr;
  const cv::Mat grey = greyImage(image);
  if (!sequence_.next(image, grey, finder_)) return nullptr;
  const TargetFrame& frame = finder_.find(grey);
  TargetDetectionsPtr message = toMessage(image->header, frame);
  addPoses(frame, grey.size(), info_ ? &*info_ : nullptr, info_topic_, pixels_, pose_, *message);
  ++frames_;
  std::size_t found = 0;
  bool is_missed = false;  // a target that should have a pose has none
  for (const TargetDetection& detection : message->detections) {
    if (detection.status != MatchStatus::STATUS_OK) continue;
    ++found;
    if (detection.has_pose != 0) ++poses_;
    is_missed |= wantsPose(detection) && detection.has_pose == 0;
  }
  found_ += found;
  if (found > 0) ++seen_;
  if (no_pose_.empty() || (is_missed && !no_pose_is_missed_)) {
    no_pose_ = message->no_pose;
    no_pose_is_missed_ = is_missed;
  }
  return message;
}

std::string BagTargets::report() const {
  if (input_.path.empty()) return "";
  std::string text = input_.path + ": " + util::counted(found_, "detection") + " in " +
                     std::to_string(seen_) + " of " + util::counted(frames_, "image") + ", " +
                     std::to_string(poses_) +
                     " of them with a pose; known targets: " + std::to_string(finder_.ids().size());
  if (refused_ > 0) text += ", refused: " + std::to_string(refused_);
  if (!no_pose_.empty()) text += "; first reason for no pose: " + no_pose_;
  return text + '\n';
}

}  // namespace ktgp_orb::tools
