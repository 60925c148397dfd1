#include "nodelet/matcher_monitor.h"

#include <algorithm>
#include <cmath>

#include "nodelet/input_watch.h"

namespace ktgp_orb {
namespace {

using diagnostic_msgs::DiagnosticStatus;
using Lock = std::lock_guard<std::mutex>;

constexpr double kPatience = 3.0;               // s to wait for a first image
constexpr double kImplausibleLatency = 3600.0;  // s; stamps of another clock, not a slow matcher

double ratio(std::uint64_t part, std::uint64_t whole) {
  return whole > 0 ? static_cast<double>(part) / static_cast<double>(whole) : 0.0;
}

}  // namespace

double MatcherMonitor::rate(const Counts& counts) {
  return counts.seconds > 0.0 ? static_cast<double>(counts.arrived) / counts.seconds : 0.0;
}

void MatcherMonitor::Counts::operator+=(const Counts& other) {
  seconds += other.seconds;
  arrived += other.arrived;
  dropped += other.dropped;
  lost += other.lost;
  refused += other.refused;
  skipped += other.skipped;
  matched += other.matched;
  no_reference += other.no_reference;
  ok += other.ok;
  inliers += other.inliers;
  latency_sum += other.latency_sum;
  latency_max = std::max(latency_max, other.latency_max);
  overlays += other.overlays;
  overlay_sum += other.overlay_sum;
  overlays_skipped += other.overlays_skipped;
}

void MatcherMonitor::setLimits(const MonitorLimits& limits) {
  const Lock lock(mutex_);
  limits_ = limits;
}

void MatcherMonitor::imageArrived() {
  const Lock lock(mutex_);
  ++current_.arrived;
  ++total_.arrived;
}

void MatcherMonitor::imageDropped() {
  const Lock lock(mutex_);
  ++current_.dropped;
  ++total_.dropped;
}

void MatcherMonitor::imagesLost(std::uint64_t count) {
  const Lock lock(mutex_);
  current_.lost += count;
  total_.lost += count;
}

void MatcherMonitor::imageSkipped() {
  const Lock lock(mutex_);
  ++current_.skipped;
  ++total_.skipped;
}

void MatcherMonitor::imageRefused(const std::string& reason) {
  const Lock lock(mutex_);
  ++current_.refused;
  ++total_.refused;
  last_error_ = reason;
}

void MatcherMonitor::setParameterError(const std::string& error) {
  const Lock lock(mutex_);
  parameter_error_ = error;
}

void MatcherMonitor::setLensProblem(const std::string& problem) {
  const Lock lock(mutex_);
  lens_problem_ = problem;
}

void MatcherMonitor::setReferenceProblem(const std::string& problem) {
  const Lock lock(mutex_);
  reference_problem_ = problem;
}

void MatcherMonitor::setMixture(const std::string& mixture) {
  const Lock lock(mutex_);
  mixture_ = mixture;
}

void MatcherMonitor::setInputTrouble(const std::string& trouble) {
  const Lock lock(mutex_);
  input_trouble_ = trouble;
}

void MatcherMonitor::overlayDrawn(double milliseconds) {
  const Lock lock(mutex_);
  ++current_.overlays;
  current_.overlay_sum += milliseconds;
}

void MatcherMonitor::overlaySkipped() {
  const Lock lock(mutex_);
  ++current_.overlays_skipped;
}

void MatcherMonitor::frameMatched(Status status, NoReference reason, std::size_t inliers,
                                  double latency_seconds) {
  const Lock lock(mutex_);
  last_status_ = status;
  last_reason_ = reason;
  if (status == Status::no_reference) {
    ++current_.no_reference;
    ++frames_without_reference_;
  } else {
    frames_without_reference_ = 0;
  }
  if (status == Status::ok) {
    ++current_.ok;
  } else if (status != Status::no_reference) {
    last_failure_ = status;
  }
  ++current_.matched;
  current_.inliers += inliers;
  current_.latency_sum += latency_seconds;
  current_.latency_max = std::max(current_.latency_max, latency_seconds);
}

void MatcherMonitor::setTopic(const std::string& topic) {
  const Lock lock(mutex_);
  topic_ = topic;
}

void MatcherMonitor::setListening(bool listening) {
  const Lock lock(mutex_);
  // Old values do not apply to the new subscription.
  if (listening && !listening_) {
    periods_ = {};
    frames_without_reference_ = 0;
  }
  listening_ = listening;
}

void MatcherMonitor::setPaused(bool paused) {
  const Lock lock(mutex_);
  paused_ = paused;
}

std::uint64_t MatcherMonitor::dropped() const {
  const Lock lock(mutex_);
  return total_.dropped;
}

std::uint64_t MatcherMonitor::lost() const {
  const Lock lock(mutex_);
  return total_.lost;
}

std::uint64_t MatcherMonitor::refused() const {
  const Lock lock(mutex_);
  return total_.refused;
}

std::uint64_t MatcherMonitor::skipped() const {
  const Lock lock(mutex_);
  return total_.skipped;
}

std::uint64_t MatcherMonitor::arrived() const {
  const Lock lock(mutex_);
  return total_.arrived;
}

void MatcherMonitor::tick(bool clock_stands, bool clock_is_missing) {
  const Lock lock(mutex_);
  const auto now = Clock::now();
  const double seconds = std::chrono::duration<double>(now - period_start_).count();
  period_start_ = now;
  clock_is_missing_ = clock_is_missing;
  clock_stands_ = clock_stands && current_.arrived == 0;
  if (clock_stands_) return;
  current_.seconds = seconds;
  periods_[next_period_] = current_;
  next_period_ = (next_period_ + 1) % periods_.size();
  current_ = {};
  if (window().refused == 0) last_error_.clear();
}

MatcherMonitor::Counts MatcherMonitor::window() const {
  Counts sum;
  for (const Counts& period : periods_) sum += period;
  return sum;
}

unsigned char MatcherMonitor::levelOf(double value, double limit) const {
  if (value <= limit) return DiagnosticStatus::OK;
  return value <= limits_.error_factor * limit ? DiagnosticStatus::WARN : DiagnosticStatus::ERROR;
}

std::string MatcherMonitor::inputMessage(const Counts& counts, unsigned char& level) const {
  level = DiagnosticStatus::OK;
  if (!listening_) return "idle: no subscriber on any output";
  if (paused_) return "paused";
  if (clock_stands_) return "the clock stands: a paused bag, or /clock has no publisher";
  if (counts.arrived == 0 && counts.seconds < kPatience) return "waits for images";
  level = DiagnosticStatus::ERROR;
  if (counts.arrived == 0) return noneOn("image", topic_, input_trouble_);
  if (!mixture_.empty()) {
    level = DiagnosticStatus::WARN;
    return mixture_;
  }
  if (counts.refused >= counts.arrived) return "every image is refused: " + last_error_;
  level = DiagnosticStatus::WARN;
  if (counts.refused > 0) return "images refused: " + last_error_;
  level = levelOf(limits_.min_input_rate, rate(counts));
  if (level != DiagnosticStatus::OK) return "images arrive too slowly";
  level = levelOf(ratio(counts.dropped, counts.arrived), limits_.max_drop_ratio);
  if (level != DiagnosticStatus::OK) {
    return "many images dropped: they arrive faster than they are matched";
  }
  level = levelOf(ratio(counts.lost, counts.arrived + counts.lost), limits_.max_lost_ratio);
  if (level != DiagnosticStatus::OK) {
    return "many images lost: they were sent, by header.seq, and never arrived";
  }
  return "images arrive";
}

void MatcherMonitor::reportInput(diagnostic_updater::DiagnosticStatusWrapper& report) {
  const Lock lock(mutex_);
  const Counts counts = window();
  unsigned char level = DiagnosticStatus::OK;
  const std::string message = inputMessage(counts, level);
  report.summary(level, message);
  report.add("topic", topic_);
  report.addf("rate (1/s)", "%.2f", rate(counts));
  report.add("images", total_.arrived);
  report.add("dropped", total_.dropped);
  report.add("lost on the way", total_.lost);
  report.add("skipped because of max_rate", total_.skipped);
  report.add("refused", total_.refused);
  report.add("last error", last_error_);
}

// A robot in front of a wall finds no homography and is not faulty: only a warning.
std::string MatcherMonitor::matcherMessage(const Counts& counts, unsigned char& level) const {
  level = DiagnosticStatus::WARN;
  if (!parameter_error_.empty()) return "parameters refused: " + parameter_error_;
  if (!lens_problem_.empty()) return lens_problem_;
  if (!reference_problem_.empty()) return reference_problem_;
  // Every sequence begins with one frame without a reference.
  if (frames_without_reference_ > 1 && listening_ && !paused_) {
    return std::to_string(frames_without_reference_) +
           " frames in a row without a reference: " + toString(last_reason_);
  }
  const std::uint64_t with_reference = counts.matched - counts.no_reference;
  const double ok_ratio = ratio(counts.ok, with_reference);
  level = DiagnosticStatus::OK;
  if (with_reference == 0) return "nothing to match";
  if (ok_ratio < limits_.min_ok_ratio) {
    level = DiagnosticStatus::WARN;
    return std::string(counts.ok == 0 ? "no homography found: " : "few homographies found: ") +
           toString(last_failure_);
  }
  return counts.ok == 0 ? "no homography found, and no output wants one" : "homographies found";
}

void MatcherMonitor::reportMatcher(diagnostic_updater::DiagnosticStatusWrapper& report) {
  const Lock lock(mutex_);
  const Counts counts = window();
  const std::uint64_t with_reference = counts.matched - counts.no_reference;
  unsigned char level = DiagnosticStatus::OK;
  const std::string message = matcherMessage(counts, level);
  report.summary(level, message);
  report.add("frames matched", with_reference);
  report.add("frames without reference", counts.no_reference);
  report.add("last reason for no reference", toString(last_reason_));
  report.addf("share with homography", "%.3f", ratio(counts.ok, with_reference));
  report.addf("inliers per homography", "%.1f", ratio(counts.inliers, counts.ok));
  report.add("last status", toString(last_status_));
  report.add("refused parameters", parameter_error_);
}

void MatcherMonitor::reportLatency(diagnostic_updater::DiagnosticStatusWrapper& report) {
  const Lock lock(mutex_);
  const Counts counts = window();
  const double mean =
      counts.matched > 0 ? counts.latency_sum / static_cast<double>(counts.matched) : 0.0;
  if (clock_is_missing_ && listening_) {
    report.summary(DiagnosticStatus::WARN,
                   "use_sim_time is set, and /clock has no publisher: the latency is not known");
  } else if (std::abs(mean) > kImplausibleLatency) {
    report.summary(
        DiagnosticStatus::WARN,
        "image stamps are of another clock; playing a bag needs use_sim_time and --clock");
  } else {
    const unsigned char level = levelOf(counts.latency_max, limits_.max_latency);
    report.summary(level,
                   level == DiagnosticStatus::OK ? "results are on time" : "results are late");
  }
  report.addf("mean (ms)", "%.2f", 1e3 * mean);
  report.addf("maximum (ms)", "%.2f", 1e3 * counts.latency_max);
  report.addf(
      "overlay, mean (ms)", "%.2f",
      counts.overlays > 0 ? counts.overlay_sum / static_cast<double>(counts.overlays) : 0.0);
  report.add("overlays skipped", counts.overlays_skipped);
}

}  // namespace ktgp_orb
