// ktgp_find IMAGE TARGETS: finds many flat targets in an image.
#include <algorithm>
#include <cstdio>
#include <iostream>

#include "files/input.h"
#include "files/output_file.h"
#include "ktgp_orb/overlay.h"
#include "ktgp_orb/target_finder.h"
#include "parameters/target_list.h"
#include "tools/matcher_cli.h"
#include "tools/program.h"
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
    "  ktgp_find photo.jpg targets.yaml --draw found.png --json found.json\n"
    "\n"
    "Exit code: 0 a target was found, 1 none was found, 2 options, inputs or outputs cannot be\n"
    "used, 130 interrupted (Ctrl-C).";

struct Arguments {
  std::string image;
  std::string targets;
  std::string json;
  std::string draw;
  bool force = false;
  TargetFinderOptions options;
};

json toJson(const DetectedTarget& detection) {
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
  out.erase("covariance");  // the corners have theirs
  return out;
}

json toJson(const Arguments& arguments, const TargetFrame& frame,
            const std::vector<std::string>& refused) {
  json detections = json::array();
  for (const DetectedTarget& detection : frame.detections) detections.push_back(toJson(detection));
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

bool isFound(const TargetFrame& frame) {
  return std::any_of(frame.detections.begin(), frame.detections.end(),
                     [](const DetectedTarget& target) { return target.status == Status::ok; });
}

void print(const TargetFrame& frame, const TargetFinderOptions& options) {
  std::printf("known targets: %zu, with a chance: %zu, keypoints: %zu, %.1f ms\n", frame.known,
              frame.candidates, frame.features, frame.milliseconds);
  for (const DetectedTarget& d : frame.detections) {
    std::printf("%s %d: %s, %zu inliers, corners", util::printable(d.id).c_str(), d.instance,
                toString(d.status), d.inliers);
    for (const Eigen::Vector2d& c : d.corners) std::printf(" (%.2f, %.2f)", c.x(), c.y());
    if (!d.ambiguity.empty()) {
      std::printf("; it looks the same %s: this pose is one of several", d.ambiguity.c_str());
    }
    std::printf("\n");
  }
  if (!frame.at_limit.empty()) {
    std::printf("%d of %s were found; there may be more: --max-instances\n", options.max_instances,
                util::printable(frame.at_limit).c_str());
  }
  const bool is_default = options.orb.max_features == TargetFinderOptions().orb.max_features;
  if (!isFound(frame)) {
    std::printf("none found%s\n",
                is_default
                    ? ". For small or distant targets try: --features 8000 --target-features 2000"
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
  app.add_option("--features", arguments.options.orb.max_features, "most keypoints of the image")
      ->check(CLI::Range(100, 100000))
      ->capture_default_str();
  app.add_option("--target-features", arguments.options.features,
                 "most keypoints of a target's image")
      ->check(CLI::Range(50, 5000))
      ->capture_default_str();
  app.add_option("--max-instances", arguments.options.max_instances, "most copies of one target")
      ->check(CLI::Range(1, 1000))
      ->capture_default_str();
  addCommonOptions(app, arguments.force);
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
  TargetFinder finder(arguments.options);
  const std::vector<std::string> refused = addTargets(entries, finder);
  for (const std::string& reason : refused) std::cerr << "ktgp_find: " << reason << '\n';
  if (finder.ids().empty()) {
    throw files::FileError(arguments.targets, "holds no target that can be used");
  }
  const TargetFrame& frame = finder.find(image);
  if (!files::isStandardOutput(arguments.json)) print(frame, arguments.options);
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
  return isFound(frame) ? kExitDone : kExitUnusedData;
}

}  // namespace
}  // namespace ktgp_orb::tools

int main(int argc, char** argv) {
  return ktgp_orb::tools::runProgram("ktgp_find",
                                     [&] { return ktgp_orb::tools::findTargets(argc, argv); });
}
