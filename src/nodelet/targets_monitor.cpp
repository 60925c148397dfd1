#include "nodelet/targets_monitor.h"

namespace ktgp_orb {

using diagnostic_msgs::DiagnosticStatus;
using Lock = std::lock_guard<std::mutex>;

void TargetsMonitor::setListening(bool listening, const std::string& image_trouble) {
  const Lock lock(mutex_);
  listening_ = listening;
  image_trouble_ = image_trouble;
}

void TargetsMonitor::imageArrived() {
  const Lock lock(mutex_);
  ++images_;
}

void TargetsMonitor::refused(const std::string& reason) {
  const Lock lock(mutex_);
  ++refused_images_;
  refusal_ = reason;
}

void TargetsMonitor::done(const TargetDetections& message) {
  const Lock lock(mutex_);
  refusal_.clear();
  last_ = message;
  found_ = message.detections.size();
  ambiguous_.clear();
  for (const TargetDetection& target : message.detections) {
    if (target.ambiguity.empty()) continue;
    ambiguous_ = target.id + " looks the same " + target.ambiguity + ": its pose is one of several";
  }
  last_.detections.clear();
}

void TargetsMonitor::targetRefused(const std::string& reason) {
  const Lock lock(mutex_);
  ++refused_targets_;
  target_refusal_ = reason;
}

void TargetsMonitor::setWaiting(std::size_t count) {
  const Lock lock(mutex_);
  waiting_ = count;
}

std::uint64_t TargetsMonitor::images() const {
  const Lock lock(mutex_);
  return images_;
}

void TargetsMonitor::report(diagnostic_updater::DiagnosticStatusWrapper& report) {
  const Lock lock(mutex_);
  if (!listening_) {
    report.summary(DiagnosticStatus::OK, "no output has a subscriber");
  } else if (!refusal_.empty()) {
    report.summary(DiagnosticStatus::ERROR, "images are refused: " + refusal_);
  } else if (!image_trouble_.empty()) {
    report.summary(DiagnosticStatus::ERROR, image_trouble_);
  } else if (!last_.no_pose.empty()) {
    report.summary(DiagnosticStatus::WARN, "a target has no pose: " + last_.no_pose);
  } else {
    report.summary(DiagnosticStatus::OK, "searches targets");
  }
  if (!last_.at_limit.empty()) {
    report.mergeSummary(DiagnosticStatus::WARN,
                        "max_instances of " + last_.at_limit + " were found; there may be more");
  }
  if (!ambiguous_.empty()) report.mergeSummary(DiagnosticStatus::WARN, ambiguous_);
  if (waiting_ == 0 && last_.known == 0 && images_ > 0) {
    report.mergeSummary(DiagnosticStatus::WARN, "no target is known");
  }
  if (refused_targets_ > 0) {
    report.mergeSummary(DiagnosticStatus::WARN, "a target was refused: " + target_refusal_);
  }
  report.add("images", images_);
  report.add("refused images", refused_images_);
  report.add("refused targets", refused_targets_);
  report.add("targets not read yet", waiting_);
  report.add("known targets", last_.known);
  report.add("found", found_);
  report.add("candidates", last_.candidates);
  report.add("tried", last_.tried);
  report.add("frames for all", last_.frames_for_all);
  report.add("milliseconds", last_.milliseconds);
}

}  // namespace ktgp_orb
