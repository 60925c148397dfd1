#include "nodelet/ground_monitor.h"

#include "nodelet/input_watch.h"

namespace ktgp_orb {

using diagnostic_msgs::DiagnosticStatus;
using Lock = std::lock_guard<std::mutex>;

std::string GroundMonitor::problemOf(const GroundEstimate& estimate, const GroundReadings& readings,
                                     const ros::Time& stamp, double patience) {
  {
    const Lock lock(mutex_);
    not_used_ = readings.notUsed(estimate);
    sources_ =
        "height from " + readings.heightSource() + ", normal from " + readings.normalSource();
  }
  if (estimate.height_used) last_height_ = stamp;
  if (estimate.down_used || !readings.usesNormal()) last_normal_ = stamp;
  const auto is_old = [&](const ros::Time& last) {
    return last > stamp || (stamp - last).toSec() > patience;
  };
  if (!estimate.hasPose()) return readings.problemOf(estimate);
  if (is_old(last_height_)) return noReading("height", readings.heightTrouble(estimate));
  if (is_old(last_normal_)) return noReading("normal", readings.normalTrouble(estimate));
  return "";
}

void GroundMonitor::setListening(bool listening, const std::string& topic,
                                 const std::string& trouble) {
  const Lock lock(mutex_);
  listening_ = listening;
  topic_ = topic;
  trouble_ = trouble;
}

void GroundMonitor::setEstimate(const GroundEstimate& estimate, double plane_deviation) {
  const Lock lock(mutex_);
  status_ = toString(estimate.status);
  numbers_["height (m)"] = estimate.height;
  numbers_["normal, deviation (rad)"] = estimate.tilt_deviation;
  numbers_["height, deviations off"] = estimate.height_misfit;
  numbers_["normal, deviations off"] = estimate.down_misfit;
  numbers_["rotation, deviations off"] = estimate.turn_misfit;
  numbers_["homography, deviations off"] = estimate.homography_misfit;
  numbers_["deviation from a plane (px)"] = plane_deviation;
  numbers_["readout time of the shutter (s)"] = estimate.readout_time;
  numbers_["readout time, deviation (s)"] = estimate.readout_deviation;
  if (estimate.gap > 0.0) numbers_["last gap (s)"] = estimate.gap;
}

void GroundMonitor::done(const std::string& problem, std::chrono::steady_clock::duration time) {
  const Lock lock(mutex_);
  problem_ = problem;
  ++matches_;
  if (problem.empty()) ++published_;
  numbers_["per frame (ms)"] = std::chrono::duration<double, std::milli>(time).count();
}

std::uint64_t GroundMonitor::matches() const {
  const Lock lock(mutex_);
  return matches_;
}

void GroundMonitor::report(diagnostic_updater::DiagnosticStatusWrapper& report) {
  const Lock lock(mutex_);
  report.summary(DiagnosticStatus::OK, "works");
  if (!listening_) {
    report.summary(DiagnosticStatus::OK, "idle: no subscriber on any output");
  } else if (matches_ == matches_before_) {
    report.summary(DiagnosticStatus::WARN, noneOn("match", topic_, trouble_));
  } else if (!problem_.empty()) {
    report.summary(DiagnosticStatus::WARN, "nothing is published: " + problem_);
  } else if (!not_used_.empty()) {
    report.summary(DiagnosticStatus::WARN, not_used_);
  }
  matches_before_ = matches_;
  report.add("sources", sources_);
  report.add("status", status_);
  report.add("not used", not_used_);
  report.add("matches", matches_);
  report.add("published", published_);
  for (const auto& [name, value] : numbers_) report.addf(name, "%.6g", value);
}

}  // namespace ktgp_orb
