#include "nodelet/diagnosis.h"

#include <ros/console.h>

#include <algorithm>
#include <cmath>
#include <utility>

#include "ros/stamps.h"
#include "util/milliseconds.h"
#include "util/printable.h"

namespace ktgp_orb {
namespace {

using diagnostic_msgs::DiagnosticStatus;
using Lock = std::lock_guard<std::mutex>;

constexpr double kMaxDropShare = 0.5;  // a larger share of dropped messages gives a warning
constexpr double kLateError = 4.0;     // a latency above this multiple of max_latency is an error
// Seconds. If the mean latency is larger than this, the stamps come from another clock. A node
// holds no image for so long: its queues have one to a few images.
constexpr double kImplausibleLatency = 60.0;
constexpr double kAhead = 0.1;  // s; stamps may be ahead of a simulated clock that ticks rarely
// A refusal is logged again only after this time. We do not use ROS_*_THROTTLE for this, because
// all nodelets of a process share its timer, and it logs nothing while ROS time is zero.
constexpr std::chrono::seconds kRepeatRefusal{5};
// A problem that comes and goes, such as one frame in ten without a homography, is logged again
// only after this time.
constexpr std::chrono::seconds kRepeatProblem{60};
constexpr const char* kIdle = "idle: no subscriber on any output";
constexpr const char* kArrived = "arrived";

double ratio(double part, double whole) {
  return whole > 0.0 ? part / whole : 0.0;
}

/// Returns the text without digits. We compare such texts, so that a problem is not logged again if
/// only its numbers change.
std::string withoutNumbers(std::string text) {
  text.erase(std::remove_if(text.begin(), text.end(),
                            [](unsigned char c) { return c >= '0' && c <= '9'; }),
             text.end());
  return text;
}

}  // namespace

void Diagnosis::open(const std::string& logger, const std::string& what, const std::string& topic,
                     const std::string& work) {
  const Lock lock(mutex_);
  logger_ = logger;
  what_ = what;
  whats_ = what + (what == "match" ? "es" : "s");
  topic_ = topic;
  work_ = work;
}

void Diagnosis::add(diagnostic_updater::Updater& updater) {
  updater.setHardwareID(topic_);
  updater.add("input", this, &Diagnosis::reportInput);
  updater.add(work_, this, &Diagnosis::reportWork);
  updater.add("latency", this, &Diagnosis::reportLatency);
}

void Diagnosis::arrived() {
  count(kArrived);
}

void Diagnosis::count(const char* name, std::uint64_t number) {
  const Lock lock(mutex_);
  auto found = counters_.find(name);
  if (found == counters_.end()) found = counters_.emplace(name, Counter()).first;
  found->second.total += number;
  found->second.current += number;
}

std::uint64_t Diagnosis::totalOf(const char* name) const {
  const auto found = counters_.find(name);
  return found == counters_.end() ? 0 : found->second.total;
}

std::uint64_t Diagnosis::recentOf(const char* name) const {
  const auto found = counters_.find(name);
  if (found == counters_.end()) return 0;
  std::uint64_t sum = 0;
  for (const std::uint64_t period : found->second.periods) sum += period;
  return sum;
}

std::uint64_t Diagnosis::total(const char* name) const {
  const Lock lock(mutex_);
  return totalOf(name);
}

std::uint64_t Diagnosis::recent(const char* name) const {
  const Lock lock(mutex_);
  return recentOf(name);
}

void Diagnosis::refuse(const std::string& reason) {
  count(kRefused);
  const Lock lock(mutex_);
  last_error_ = util::printable(reason, 600);
  const auto now = Clock::now();
  if (now - last_refusal_ < kRepeatRefusal) return;
  last_refusal_ = now;
  ROS_ERROR_NAMED(logger_, "%s on %s is refused: %s", what_.c_str(), topic_.c_str(),
                  last_error_.c_str());
}

double Diagnosis::done(const ros::Time& stamp, Clock::time_point start) {
  const double milliseconds = util::millisecondsSince(start);
  const ros::Time now = ros::Time::now();
  const double latency = stamp.isZero() || now.isZero() ? 0.0 : secondsBetween(stamp, now);
  count(kDone);
  const Lock lock(mutex_);
  current_.latency += latency;
  current_.max_latency = std::max(current_.max_latency, latency);
  current_.milliseconds += milliseconds;
  return latency;
}

void Diagnosis::set(const std::string& kind, const std::string& text, bool log,
                    Problems& problems) {
  if (text.empty()) {
    problems.erase(kind);
    return;
  }
  const std::string line = util::printable(text, 600);
  const std::string before = std::exchange(problems[kind], line);
  const std::string words = withoutNumbers(line);
  if (!log || withoutNumbers(before) == words) return;
  Logged& logged = logged_[kind];
  const auto now = Clock::now();
  if (logged.words == words && now - logged.time < kRepeatProblem) return;
  logged = {words, now};
  ROS_WARN_NAMED(logger_, "%s", line.c_str());
}

void Diagnosis::setProblem(const std::string& kind, const std::string& text, bool log) {
  const Lock lock(mutex_);
  // The worker may still be at a frame when the inputs are unsubscribed.
  if (listening_) set(kind, text, log, problems_);
}

void Diagnosis::setFault(const std::string& kind, const std::string& text, bool log) {
  const Lock lock(mutex_);
  set(kind, text, log, faults_);
}

void Diagnosis::setState(const std::string& text) {
  const Lock lock(mutex_);
  state_ = text;
}

void Diagnosis::setValue(std::string_view name, std::string_view value) {
  const Lock lock(mutex_);
  auto found = values_.find(name);
  if (found == values_.end()) found = values_.emplace(name, "").first;
  found->second = value;
}

void Diagnosis::setMaxLatency(double seconds) {
  const Lock lock(mutex_);
  max_latency_ = seconds;
}

void Diagnosis::setListening(bool listening) {
  const Lock lock(mutex_);
  if (listening && !listening_) {  // forget the values of the last subscription
    periods_ = {};
    for (auto& [name, counter] : counters_) counter.periods = {};
    silence_.clear();
  }
  problems_.clear();
  listening_ = listening;
}

void Diagnosis::setPaused(bool paused) {
  const Lock lock(mutex_);
  paused_ = paused;
}

void Diagnosis::setInput(const std::string& silence, const std::string& mixture) {
  const Lock lock(mutex_);
  if (!mixture.empty() && mixture_.empty()) ROS_WARN_NAMED(logger_, "%s", mixture.c_str());
  silence_ = silence;
  mixture_ = mixture;
}

void Diagnosis::tick(bool clock_stands, bool clock_is_missing) {
  const Lock lock(mutex_);
  const auto now = Clock::now();
  const double seconds = std::chrono::duration<double>(now - period_start_).count();
  period_start_ = now;
  clock_is_missing_ = clock_is_missing;
  const auto arrived = counters_.find(kArrived);
  clock_stands_ = clock_stands && (arrived == counters_.end() || arrived->second.current == 0);
  if (clock_stands_) return;
  current_.seconds = seconds;
  periods_[next_period_] = std::exchange(current_, {});
  for (auto& [name, counter] : counters_) {
    counter.periods[next_period_] = std::exchange(counter.current, 0);
  }
  next_period_ = (next_period_ + 1) % kPeriods;
  if (recentOf(kRefused) == 0) last_error_.clear();
}

Diagnosis::Times Diagnosis::times() const {
  Times sum;
  for (const Times& period : periods_) {
    sum.seconds += period.seconds;
    sum.latency += period.latency;
    sum.max_latency = std::max(sum.max_latency, period.max_latency);
    sum.milliseconds += period.milliseconds;
  }
  return sum;
}

std::string Diagnosis::inputMessage(unsigned char& level) const {
  const auto arrived = static_cast<double>(recentOf(kArrived));
  const auto refused = static_cast<double>(recentOf(kRefused));
  level = DiagnosticStatus::OK;
  if (!listening_) return kIdle;
  if (paused_) return "paused";
  if (clock_stands_) return "the clock stands: a paused bag, or /clock has no publisher";
  level = DiagnosticStatus::ERROR;
  if (!silence_.empty()) return silence_;
  if (refused > 0 && refused >= arrived) return "every " + what_ + " is refused: " + last_error_;
  level = DiagnosticStatus::WARN;
  if (!mixture_.empty()) return mixture_;
  if (refused > 0) return whats_ + " refused: " + last_error_;
  if (recentOf(kForgotten) > 0) {
    return whats_ + " were dropped to save memory before their homography arrived";
  }
  if (ratio(static_cast<double>(recentOf(kDropped)), arrived) > kMaxDropShare) {
    return "many " + whats_ + " dropped: they arrive faster than they are worked on";
  }
  level = DiagnosticStatus::OK;
  return arrived == 0 ? "waits for " + whats_ : whats_ + " arrive";
}

void Diagnosis::reportInput(Report& report) {
  const Lock lock(mutex_);
  unsigned char level = DiagnosticStatus::OK;
  const std::string message = inputMessage(level);
  report.summary(level, message);
  report.add("topic", topic_);
  report.addf("rate (1/s)", "%.2f",
              ratio(static_cast<double>(recentOf(kArrived)), times().seconds));
  report.add(whats_, totalOf(kArrived));
  for (const char* name : {kDropped, kForgotten, kLost, kSkipped, kRefused}) {
    report.add(name, totalOf(name));
  }
  report.add("last error", last_error_);
}

void Diagnosis::reportWork(Report& report) {
  const Lock lock(mutex_);
  std::string message;
  for (const Problems* problems : {&faults_, &problems_}) {
    for (const auto& [kind, text] : *problems) message += (message.empty() ? "" : "; ") + text;
  }
  if (message.empty()) {
    report.summary(DiagnosticStatus::OK, listening_ ? state_ : kIdle);
  } else {
    report.summary(DiagnosticStatus::WARN, message);
  }
  for (const auto& [name, value] : values_) report.add(name, value);
  for (const auto& [name, counter] : counters_) {
    const bool is_of_input = name == kArrived || name == kDropped || name == kForgotten ||
                             name == kLost || name == kSkipped || name == kRefused;
    if (!is_of_input) report.add(name, counter.total);
  }
}

// The latency is unknown if a simulated clock never started or the stamps come from another clock.
void Diagnosis::reportLatency(Report& report) {
  const Lock lock(mutex_);
  const Times sum = times();
  const auto frames = static_cast<double>(recentOf(kDone));
  const double mean = ratio(sum.latency, frames);
  if (clock_is_missing_ && listening_) {
    report.summary(DiagnosticStatus::WARN,
                   "use_sim_time is set, and /clock has no publisher: the latency is not known");
  } else if (frames > 0.0 && mean < -kAhead && mean > -kImplausibleLatency) {
    report.summary(DiagnosticStatus::WARN,
                   "image stamps are ahead of this computer's clock; synchronise the clocks");
  } else if (std::abs(mean) > kImplausibleLatency) {
    report.summary(
        DiagnosticStatus::WARN,
        "image stamps are of another clock; playing a bag needs use_sim_time and --clock");
  } else if (sum.max_latency > max_latency_) {
    const bool is_error = sum.max_latency > kLateError * max_latency_;
    report.summary(is_error ? DiagnosticStatus::ERROR : DiagnosticStatus::WARN, "results are late");
  } else {
    report.summary(DiagnosticStatus::OK, "results are on time");
  }
  report.addf("mean (ms)", "%.2f", 1e3 * mean);
  report.addf("maximum (ms)", "%.2f", frames > 0.0 ? 1e3 * sum.max_latency : 0.0);
  report.addf("work per frame, mean (ms)", "%.2f", ratio(sum.milliseconds, frames));
}

}  // namespace ktgp_orb
