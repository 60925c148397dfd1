// ktgp_find IMAGE TARGETS: finds many flat targets in an image.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <iostream>
#include <nlohmann/json.hpp>

#include "files/input.h"
#include "files/output_file.h"
#include "files/target_list.h"
#include "files/tiff_pages.h"
#include "ktgp_orb/overlay.h"
#include "ktgp_orb/planar_pose.h"
#include "ktgp_orb/target_finder.h"
#include "tools/matcher_cli.h"
#include "tools/program.h"
#include "util/camera_check.h"
#include "util/printable.h"

namespace ktgp_orb::tools {
namespace {

using nlohmann::json;

constexpr const char* kDescription =
    "Finds flat targets, such as posters, signs or maps, in an image. TARGETS is a folder with an\n"
    "image of each target (the file's name is its id), or a YAML list:\n"
    "  - {id: door, image: door.png, width: 0.8, frame: door}\n"
    "  - {id: map, images: [day.jpg, night.jpg]}\n"
    "A target that cannot be used is named with the reason; the others are searched.";

constexpr const char* kExamples =
    "Examples:\n"
    "  ktgp_find photo.jpg posters\n"
    "  ktgp_find photo.jpg posters --draw found.png --json found.json\n"
    "  ktgp_find photo.jpg targets.yaml --camera 718.9,718.9,607.2,185.2      the poses, too\n"
    "\n"
    "Exit code: 0 a target was found, 1 none was found, 2 options, inputs or outputs cannot be\n"
    "used, 130 interrupted (Ctrl-C).";

struct Arguments {
  std::string image;
  std::string targets;
  std::string json;
  std::string draw;
  std::vector<double> camera;
  bool force = false;
  TargetFinderOptions options;
};

/// The possible poses of the target in the camera's frame. The unit is the metre or, if the width
/// of the target is unknown, this width.
PlanarPoses posesOf(const DetectedTarget& target, const Eigen::Matrix3d& camera) {
  return planarPoses(target.homography.homography, target.homography.covariance, camera,
                     target.image_size, target.width > 0.0 ? target.width : 1.0);
}

json toJson(const PlanarPose& pose) {
  const Eigen::Vector3d t = pose.target_to_camera.translation();
  return {{"rotation", tools::toJson(Eigen::Matrix3d(pose.target_to_camera.linear()))},
          {"translation", {t.x(), t.y(), t.z()}},
          {"covariance", rowsOf(pose.covariance)},
          {"share", pose.share}};
}

json toJson(const DetectedTarget& detection, const std::optional<Eigen::Matrix3d>& camera) {
  json corners = json::array();
  json covariances = json::array();
  for (std::size_t i = 0; i < detection.corners.size(); ++i) {
    const auto& c = detection.corner_covariances[i];
    corners.push_back({detection.corners[i].x(), detection.corners[i].y()});
    covariances.push_back({{c(0, 0), c(0, 1)}, {c(1, 0), c(1, 1)}});
  }
  json out{{"id", detection.id},
           {"instance", detection.instance},
           {"status", toString(detection.status)},
           {"uncertain", detection.uncertain},
           {"image", detection.image},
           {"corners", corners},
           {"corner_covariances", covariances},
           {"inliers", detection.inliers},
           {"aligned", detection.aligned},
           {"log_false_alarms", detection.log_false_alarms},
           {"width", detection.width},
           {"frame", detection.frame},
           {"ambiguity", detection.ambiguity}};
  out.update(tools::toJson(detection.homography));
  out.erase("covariance");  // not printed: each corner has its own covariance
  if (!camera || detection.status != Status::ok) return out;
  out["poses"] = json::array();
  for (const PlanarPose& pose : posesOf(detection, *camera).poses) {
    out["poses"].push_back(toJson(pose));
  }
  return out;
}

json toJson(const Arguments& arguments, const TargetFrame& frame,
            const std::vector<std::string>& refused) {
  json detections = json::array();
  const auto camera = cameraFrom(arguments.camera);
  for (const DetectedTarget& detection : frame.detections) {
    detections.push_back(toJson(detection, camera));
  }
  return {{"image", arguments.image},
          {"targets", frame.known},
          {"refused", refused},
          {"keypoints", frame.features},
          {"candidates", frame.candidates},
          {"tried", frame.tried},
          {"milliseconds", frame.milliseconds},
          {"at_limit", frame.at_limit},
          {"detections", detections}};
}

/// Names the files of which only the first page is used.
void notePages(const std::string& image, const std::vector<TargetEntry>& entries) {
  std::vector<std::string> names{image};
  for (const TargetEntry& entry : entries) {
    names.insert(names.end(), entry.files.begin(), entry.files.end());
  }
  for (const std::string& file : names) {
    const std::string note = files::noteOnPages(file);
    if (!note.empty()) std::cerr << "ktgp_find: " << note << '\n';
  }
}

bool isFound(const TargetFrame& frame) {
  return std::any_of(frame.detections.begin(), frame.detections.end(),
                     [](const DetectedTarget& target) { return target.status == Status::ok; });
}

void printPoses(const DetectedTarget& target, const Eigen::Matrix3d& camera) {
  const PlanarPoses found = posesOf(target, camera);
  const char* const unit = target.width > 0.0 ? "m" : "widths of the target";
  if (found.poses.empty()) std::printf("  no pose: %s\n", found.problem.c_str());
  for (const PlanarPose& pose : found.poses) {
    const Eigen::Vector3d t = pose.target_to_camera.translation();
    const Eigen::Vector3d normal = pose.target_to_camera.linear().col(2);
    std::printf(
        "  pose (share %.2f): at (%.4f, %.4f, %.4f) +- %.4f %s, tilted by %.1f degrees +- %.1f\n",
        pose.share, t.x(), t.y(), t.z(), std::sqrt(pose.covariance.topLeftCorner<3, 3>().trace()),
        unit, 180.0 / CV_PI * std::acos(std::min(1.0, std::abs(normal.dot(t.normalized())))),
        180.0 / CV_PI * std::sqrt(pose.covariance.bottomRightCorner<3, 3>().trace()));
  }
}

void print(const TargetFrame& frame, const Arguments& arguments) {
  const TargetFinderOptions& options = arguments.options;
  const auto camera = cameraFrom(arguments.camera);
  std::printf("known targets: %zu, of these with similar keypoints: %zu, keypoints: %zu, %.1f ms\n",
              frame.known, frame.candidates, frame.features, frame.milliseconds);
  for (const DetectedTarget& d : frame.detections) {
    std::printf(
        "%s %d: %s, %zu inliers, corners", util::printable(d.id).c_str(), d.instance,
        d.uncertain ? "seen, but its corners could be more than 5 px off" : toString(d.status),
        d.inliers);
    for (const Eigen::Vector2d& c : d.corners) std::printf(" (%.2f, %.2f)", c.x(), c.y());
    if (!d.ambiguity.empty()) {
      std::printf("; it looks the same %s: this pose is one of several", d.ambiguity.c_str());
    }
    std::printf("\n");
    if (camera && d.status == Status::ok) printPoses(d, *camera);
  }
  if (!frame.at_limit.empty()) {
    std::printf("%d of %s were found; there may be more: --max-instances\n", options.max_instances,
                util::printable(frame.at_limit).c_str());
  }
  const bool is_default = options.orb.max_features == TargetFinderOptions().orb.max_features;
  if (!isFound(frame)) {
    std::printf(
        "none found.%s For one that is tilted by 60 degrees or more: ktgp_match with the "
        "target's image and this one\n",
        is_default ? " For small or distant targets try: --features 8000 --target-features 2000."
                   : "");
  }
}

void addArguments(CLI::App& app, Arguments& arguments) {
  const auto file = [&](const char* name, std::string& value, const char* description) {
    return app.add_option(name, value, description)->type_name("FILE");
  };
  file("IMAGE", arguments.image, "image to search")->required();
  file("TARGETS", arguments.targets, "folder of images, or YAML list")->required();
  file("--json", arguments.json, "write all results; - is the standard output");
  file("--draw", arguments.draw, "write the image with the outlines and ids of what was found");
  addCameraOption(
      app, "--camera", arguments.camera,
      "K of the image without distortion, px: also print the poses, in m where a target "
      "has a width, else in its widths");
  app.add_option("--features", arguments.options.orb.max_features, "most keypoints of the image")
      ->check(wholeNumberIn(100, 100000))
      ->capture_default_str();
  app.add_option("--target-features", arguments.options.features,
                 "most keypoints of a target's image")
      ->check(wholeNumberIn(50, 5000))
      ->capture_default_str();
  app.add_option("--max-instances", arguments.options.max_instances, "most copies of one target")
      ->check(wholeNumberIn(1, 1000))
      ->capture_default_str();
  addCommonOptions(app, arguments.force);
}

void write(const Arguments& arguments, const TargetFrame& frame,
           const std::vector<std::string>& refused) {
  files::Outputs outputs(arguments.force);
  if (!arguments.json.empty()) {
    outputs.writeText(arguments.json, textOf(toJson(arguments, frame, refused), 2));
  }
  if (!arguments.draw.empty()) {
    cv::Mat canvas;
    drawTargets(files::readForView(arguments.image), frame.detections, canvas);
    outputs.writeImage(arguments.draw, canvas);
  }
  outputs.commit();
}

int findTargets(int argc, char** argv) {
  Arguments arguments;
  CLI::App app(kDescription);
  app.footer(kExamples);
  addArguments(app, arguments);
  if (const auto code = parse(app, argc, argv)) return *code;

  const std::vector<TargetEntry> entries = readTargetList(arguments.targets);
  files::OutputPlan plan = planOutputs(app, arguments.force);
  for (const TargetEntry& entry : entries) {
    for (const std::string& file : entry.files) plan.read(file);
  }
  plan.write(arguments.json);
  plan.writeImage(arguments.draw);
  exitWhenInterrupted();

  const cv::Mat image = files::readGrey(arguments.image);
  if (const auto camera = cameraFrom(arguments.camera)) {
    util::requireK("--camera", *camera, image.size());
    util::requirePrincipalPoint("--camera", *camera, image.size());
  }
  notePages(arguments.image, entries);
  TargetFinder finder(arguments.options);
  const std::vector<std::string> refused = addTargets(entries, finder);
  for (const std::string& reason : refused) std::cerr << "ktgp_find: " << reason << '\n';
  if (finder.ids().empty()) {
    throw files::FileError(arguments.targets, "holds no target that can be used");
  }
  const TargetFrame& frame = finder.find(image);
  if (!files::isStandardOutput(arguments.json)) print(frame, arguments);
  write(arguments, frame, refused);
  return isFound(frame) ? kExitDone : kExitUnusedData;
}

}  // namespace
}  // namespace ktgp_orb::tools

int main(int argc, char** argv) {
  return ktgp_orb::tools::runProgram("ktgp_find",
                                     [&] { return ktgp_orb::tools::findTargets(argc, argv); });
}
