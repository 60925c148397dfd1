#pragma once

#include <diagnostic_updater/diagnostic_updater.h>

#include <array>
#include <chrono>
#include <cstdint>
#include <limits>
#include <map>
#include <mutex>
#include <string>

namespace ktgp_orb {

/// Reports on input, work and problems of a nodelet: three entries of /diagnostics ("input", one
/// with the name of the work, and "latency") over the last ten seconds. A problem is in the log
/// once and in the diagnostics as long as it lasts. All functions may be called from any thread.
class Diagnosis {
 public:
  using Clock = std::chrono::steady_clock;
  using Report = diagnostic_updater::DiagnosticStatusWrapper;

  /// `logger`: name of the nodelet; `what`: what arrives, "image" or "match"; `work`: name of the
  /// second report.
  void open(const std::string& logger, const std::string& what, const std::string& topic,
            const std::string& work);
  void add(diagnostic_updater::Updater& updater);

  // Names of counters that all nodelets share; others are free. They are keys of the reports.
  static constexpr const char* kDropped = "dropped";
  static constexpr const char* kForgotten = "dropped because of memory";
  static constexpr const char* kLost = "lost on the way";
  static constexpr const char* kSkipped = "skipped because of max_rate";
  static constexpr const char* kRefused = "refused";
  static constexpr const char* kRepeated = "repeated";
  static constexpr const char* kDone = "frames done";

  void arrived();
  void count(const char* name, std::uint64_t number = 1);
  /// Counts since the start, and in the last ten seconds.
  std::uint64_t total(const char* name) const;
  std::uint64_t recent(const char* name) const;
  /// An image or message that cannot be used.
  void refuse(const std::string& reason);
  /// The work on the frame with this stamp, begun at `start`, is done. Returns its latency, s: from
  /// the stamp to now; 0 without a stamp or a clock.
  double done(const ros::Time& stamp, Clock::time_point start);

  /// A problem of this kind with the frames; it ends when none are received. Empty: none. `log`:
  /// say it in the log, too.
  void setProblem(const std::string& kind, const std::string& text, bool log = true);
  /// A problem that lasts whether or not frames are received.
  void setFault(const std::string& kind, const std::string& text, bool log = true);
  /// Text where there is no problem, "works" for example.
  void setState(const std::string& text);
  /// A value of the report, shown as it is.
  void setValue(const std::string& name, const std::string& value);
  /// Latency that is reported as late, s.
  void setMaxLatency(double seconds);

  void setListening(bool listening);
  void setPaused(bool paused);
  /// `silence`: which input is silent, and why; `mixture`: that several nodes publish it. Each may
  /// be empty.
  void setInput(const std::string& silence, const std::string& mixture);

  /// Moves the ten seconds forward; once a second, before the reports. While the clock stands and
  /// nothing arrives (a paused bag) they do not move. `clock_is_missing`: ROS time is simulated and
  /// its clock never started.
  void tick(bool clock_stands, bool clock_is_missing);

 private:
  using Problems = std::map<std::string, std::string>;  // by their kinds
  static constexpr std::size_t kPeriods = 10;

  struct Counter {
    std::uint64_t total = 0;
    std::uint64_t current = 0;
    std::array<std::uint64_t, kPeriods> periods{};
  };
  struct Times {
    double seconds = 0.0;
    double latency = 0.0;
    double max_latency = 0.0;
    double milliseconds = 0.0;
  };
  // Call these with mutex_ locked.
  void set(const std::string& kind, const std::string& text, bool log, Problems& problems);
  std::uint64_t recentOf(const char* name) const;
  std::uint64_t totalOf(const char* name) const;
  Times times() const;
  std::string inputMessage(unsigned char& level) const;
  void reportInput(Report& report);
  void reportWork(Report& report);
  void reportLatency(Report& report);

  mutable std::mutex mutex_;
  std::string logger_;
  std::string what_;
  std::string whats_;  // plural of what arrives
  std::string topic_;
  std::string work_;
  std::map<std::string, Counter, std::less<>> counters_;
  Times current_;
  std::array<Times, kPeriods> periods_;
  std::size_t next_period_ = 0;
  Clock::time_point period_start_ = Clock::now();
  Clock::time_point last_refusal_;
  std::string last_error_;  // as long as images are refused
  Problems problems_;
  Problems faults_;
  std::string state_ = "works";
  std::map<std::string, std::string> values_;
  double max_latency_ = std::numeric_limits<double>::infinity();
  bool listening_ = false;
  bool paused_ = false;
  std::string silence_;
  std::string mixture_;
  bool clock_stands_ = false;
  bool clock_is_missing_ = false;
};

}  // namespace ktgp_orb
