#pragma once

#include <diagnostic_updater/diagnostic_updater.h>

#include <array>
#include <chrono>
#include <cstdint>
#include <mutex>
#include <string>

#include "ktgp_orb/status.h"

namespace ktgp_orb {

/// Limits beyond which diagnostics warn; see cfg/Ktgp.cfg.
struct MonitorLimits {
  double min_input_rate = 0.0;  ///< images per second
  double max_drop_ratio = 0.5;  ///< dropped / arrived
  double max_latency = 0.5;     ///< s
  double min_ok_ratio = 0.5;    ///< frames with a homography / frames with a reference
  double error_factor = 4.0;    ///< an error, no warning, this many times beyond a limit
};

/// Counts what happens to the images and reports it to diagnostics over the last ten seconds.
/// All functions may be called from any thread.
class MatcherMonitor {
 public:
  void setLimits(const MonitorLimits& limits);

  void imageArrived();
  void imageDropped();
  void imageRefused(const std::string& reason);
  void setError(const std::string& error);
  void frameMatched(Status status, std::size_t inliers, double latency_seconds);
  void setTopic(const std::string& topic);
  void setListening(bool listening);
  void setPaused(bool paused);

  std::uint64_t dropped() const;
  std::uint64_t refused() const;
  std::uint64_t arrived() const;

  /// Moves the window on by one period; call once before each round of reports. While the clock
  /// stands (a paused bag) the window stands too.
  void tick(bool clock_stands);
  void reportInput(diagnostic_updater::DiagnosticStatusWrapper& report);
  void reportMatcher(diagnostic_updater::DiagnosticStatusWrapper& report);
  void reportLatency(diagnostic_updater::DiagnosticStatusWrapper& report);

 private:
  using Clock = std::chrono::steady_clock;

  struct Counts {
    double seconds = 0.0;
    std::uint64_t arrived = 0;
    std::uint64_t dropped = 0;
    std::uint64_t refused = 0;
    std::uint64_t matched = 0;
    std::uint64_t no_reference = 0;
    std::uint64_t ok = 0;
    std::uint64_t inliers = 0;
    double latency_sum = 0.0;
    double latency_max = 0.0;

    void operator+=(const Counts& other);
  };

  Counts window() const;
  static double rate(const Counts& counts);
  /// Of a measured value and its upper limit, or of a lower limit and the measured value.
  unsigned char levelOf(double value, double limit) const;
  std::string inputMessage(const Counts& counts, unsigned char& level) const;

  mutable std::mutex mutex_;
  MonitorLimits limits_;
  Counts current_;
  Counts total_;
  std::array<Counts, 10> periods_;
  std::size_t next_period_ = 0;
  Clock::time_point period_start_ = Clock::now();
  std::string last_error_;
  std::string topic_;
  bool listening_ = false;
  bool paused_ = false;
  bool clock_stands_ = false;
  Status last_status_ = Status::no_reference;
};

}  // namespace ktgp_orb
