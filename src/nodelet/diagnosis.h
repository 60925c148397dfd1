#pragma once

#include <diagnostic_updater/diagnostic_updater.h>

#include <array>
#include <chrono>
#include <cstdint>
#include <functional>
#include <limits>
#include <map>
#include <mutex>
#include <string>
#include <string_view>

namespace ktgp_orb {

/// Reports on input, work and problems of a nodelet over the last ten seconds. It publishes three
/// entries on /diagnostics: "input", an entry that is named after the work of the nodelet (see
/// open()), and "latency". A problem is logged once, and stays in the diagnostics while it lasts.
/// All functions may be called from any thread.
class Diagnosis {
 public:
  using Clock = std::chrono::steady_clock;
  using Report = diagnostic_updater::DiagnosticStatusWrapper;

  /// `logger`: name of the nodelet. `what`: kind of the input, "image" or "match". `work`: name of
  /// the entry that reports on the work, for example "motion".
  void open(const std::string& logger, const std::string& what, const std::string& topic,
            const std::string& work);
  void add(diagnostic_updater::Updater& updater);

  // Names of the counters that all nodelets use; /diagnostics shows the counters under these names.
  // Nodelets may add counters with other names.
  static constexpr const char* kDropped = "dropped";
  static constexpr const char* kForgotten = "dropped because of memory";
  static constexpr const char* kLost = "lost on the way";
  static constexpr const char* kSkipped = "skipped because of max_rate";
  static constexpr const char* kRefused = "refused";
  static constexpr const char* kRepeated = "repeated";
  static constexpr const char* kDone = "frames done";

  void arrived();
  void count(const char* name, std::uint64_t number = 1);
  /// The count since the start, and the count of the last ten seconds.
  std::uint64_t total(const char* name) const;
  std::uint64_t recent(const char* name) const;
  /// Counts an image or message that cannot be used, and reports the reason.
  void refuse(const std::string& reason);
  /// Call this when a frame is done. `stamp`: stamp of the frame. `start`: time when the work on it
  /// began. Returns the latency from the stamp to now, s; 0 if the stamp or the ROS time is zero.
  double done(const ros::Time& stamp, Clock::time_point start);

  /// Reports a problem with the frames until it is cleared. `kind`: name that identifies the
  /// problem. `text`: description; an empty text clears the problem. Unsubscribing the inputs
  /// clears it, too, and until they are subscribed again, problems are ignored. `log`: also write
  /// the problem to the log, the same one at most once a minute.
  void setProblem(const std::string& kind, const std::string& text, bool log = true);
  /// Like setProblem(), but unsubscribing the inputs does not clear the problem.
  void setFault(const std::string& kind, const std::string& text, bool log = true);
  /// Sets the text that the work's entry shows while there is no problem, for example "works".
  void setState(const std::string& text);
  /// Sets a value that the work's entry in the diagnostics shows under `name`.
  void setValue(std::string_view name, std::string_view value);
  /// Sets the latency above which results are reported as late, s.
  void setMaxLatency(double seconds);

  void setListening(bool listening);
  void setPaused(bool paused);
  /// `silence`: text that says which input is silent, and why. `mixture`: text that says that
  /// several nodes publish the same input. Either text may be empty.
  void setInput(const std::string& silence, const std::string& mixture);

  /// Moves the window of ten seconds forward; called once a second, before the reports. The window
  /// does not move while the clock stands still and nothing arrives (a paused bag). `clock_stands`:
  /// simulated ROS time has not changed since the last call. `clock_is_missing`: ROS time is
  /// simulated, and its clock never started.
  void tick(bool clock_stands, bool clock_is_missing);

 private:
  using Problems = std::map<std::string, std::string>;  // kind and text of each problem
  static constexpr std::size_t kPeriods = 10;

  struct Counter {
    std::uint64_t total = 0;
    std::uint64_t current = 0;
    std::array<std::uint64_t, kPeriods> periods{};
  };
  struct Times {
    double seconds = 0.0;
    double latency = 0.0;
    double max_latency = -std::numeric_limits<double>::infinity();
    double milliseconds = 0.0;
  };
  struct Logged {
    std::string words;  // the last text in the log, without its numbers
    Clock::time_point time;
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
  std::string whats_;  // plural of the kind of the input, for example "images"
  std::string topic_;
  std::string work_;
  std::map<std::string, Counter, std::less<>> counters_;
  Times current_;
  std::array<Times, kPeriods> periods_;
  std::size_t next_period_ = 0;
  Clock::time_point period_start_ = Clock::now();
  Clock::time_point last_refusal_;
  std::string last_error_;  // reason of the last refusal; empty if nothing was refused recently
  std::map<std::string, Logged, std::less<>> logged_;  // by kind of problem
  Problems problems_;
  Problems faults_;
  std::string state_ = "works";
  std::map<std::string, std::string, std::less<>> values_;
  double max_latency_ = std::numeric_limits<double>::infinity();
  bool listening_ = false;
  bool paused_ = false;
  std::string silence_;
  std::string mixture_;
  bool clock_stands_ = false;
  bool clock_is_missing_ = false;
};

}  // namespace ktgp_orb
