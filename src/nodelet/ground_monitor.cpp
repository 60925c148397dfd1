#include "nodelet/ground_monitor.h"

#include "nodelet/input_watch.h"

namespace ktgp_orb {

using diagnostic_msgs::DiagnosticStatus;
using Lock = std::lock_guard<std::mutex>;

namespace {

/// There is no reason where the newest reading was already used for an earlier frame.
std::string none(const std::string& what, const std::string& why) {
  return "no " + what + ": " + (why.empty() ? "no new reading yet" : why);
}

}  // namespace

std::string GroundMonitor::problemOf(const GroundEstimate& estimate, const GroundReadings& readings,
                                     const ros::Time& stamp, double patience) {
  constexpr double kLimit = GroundEstimate::kContradiction;
  const std::string contradicts = " contradicts the homography";
  const std::string height = estimate.height_misfit > kLimit
                                 ? "that of " + readings.heightSource() + contradicts
                                 : readings.noHeight();
  const std::string normal = estimate.down_misfit > kLimit
                                 ? "that of " + readings.normalSource() + contradicts
                                 : readings.noNormal();
  {
    const Lock lock(mutex_);
    not_used_ = !height.empty()   ? "height: " + height
                : !normal.empty() ? "normal: " + normal
                                  : readings.noTurn();
    sources_ =
        "height from " + readings.heightSource() + ", normal from " + readings.normalSource();
  }
  if (estimate.height_used) last_height_ = stamp;
  if (estimate.down_used || !readings.usesNormal()) last_normal_ = stamp;
  const auto is_old = [&](const ros::Time& last) {
    return last > stamp || (stamp - last).toSec() > patience;
  };
  switch (estimate.status) {
    case GroundStatus::no_homography:
      return "the matcher found no homography";
    case GroundStatus::no_covariance:
      return "the homography has no covariance";
    case GroundStatus::no_height:
      return none("height", height);
    case GroundStatus::no_normal:
      return "no normal: " + (normal.empty() ? "the motion does not show it yet" : normal);
    case GroundStatus::contradiction:
      return "the homography contradicts the height and the normal of earlier frames";
    case GroundStatus::looks_away:
      return "the camera looks above the horizon: its tf, or the direction of gravity, is wrong";
    case GroundStatus::stamp_went_back:
      return "the stamp went back: the odometry begins anew";
    case GroundStatus::not_finite:
      return "numbers too large to compute with: the odometry begins anew";
    case GroundStatus::ok:
    case GroundStatus::started:
    case GroundStatus::resumed:
      break;
  }
  if (is_old(last_height_)) return none("height", height);
  if (is_old(last_normal_)) return none("normal", normal);
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
  numbers_["deviation from a plane (px)"] = plane_deviation;
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
