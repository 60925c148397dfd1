#pragma once

#include <diagnostic_updater/diagnostic_updater.h>

#include <array>
#include <chrono>
#include <cstdint>
#include <mutex>
#include <string>

#include "ktgp_orb/sequence_matcher.h"

namespace ktgp_orb {

/// Limits for warnings in diagnostics; see cfg/Ktgp.cfg.
struct MonitorLimits {
  double min_input_rate = 0.0;  ///< images per second
  double max_drop_ratio = 0.5;  ///< dropped / arrived
  double max_lost_ratio = 1.0;  ///< lost on the way / sent
  double max_latency = 0.5;     ///< s
  double min_ok_ratio = 0.5;    ///< frames with a homography / frames with a reference
  double error_factor = 4.0;    ///< an error in place of a warning from this multiple of a limit on
};

/// Counts what happens to the images and reports it to diagnostics over the last ten seconds.
/// All functions may be called from any thread.
class MatcherMonitor {
 public:
  void setLimits(const MonitorLimits& limits);

  void imageArrived();
  /// Replaced by a newer one before it was matched.
  void imageDropped();
  /// Sent, according to the publisher's counter, but not received.
  void imagesLost(std::uint64_t count);
  /// Skipped because of max_rate.
  void imageSkipped();
  void imageRefused(const std::string& reason);
  /// Why the last change of parameters was refused; empty: it was accepted.
  void setParameterError(const std::string& error);
  /// Why points are in raw pixels although rectified ones are wanted; empty: no problem.
  void setLensProblem(const std::string& problem);
  /// A problem with the reference that users should know; empty: none.
  void setReferenceProblem(const std::string& problem);
  /// That several nodes publish the images; empty: only one does.
  void setMixture(const std::string& mixture);
  /// Why images are missing; empty: not known.
  void setInputTrouble(const std::string& trouble);
  void frameMatched(Status status, NoReference reason, std::size_t inliers, double latency_seconds);
  void overlayDrawn(double milliseconds);
  /// Not drawn, because a newer image waited.
  void overlaySkipped();
  void setTopic(const std::string& topic);
  void setListening(bool listening);
  void setPaused(bool paused);

  std::uint64_t dropped() const;
  std::uint64_t lost() const;
  std::uint64_t refused() const;
  std::uint64_t skipped() const;
  std::uint64_t arrived() const;

  /// Moves the window forward by one period; call once before each round of reports. While the
  /// clock stands and nothing arrives (a paused bag), the window does not move. `clock_is_missing`:
  /// ROS time is simulated and its clock never started.
  void tick(bool clock_stands, bool clock_is_missing);
  void reportInput(diagnostic_updater::DiagnosticStatusWrapper& report);
  void reportMatcher(diagnostic_updater::DiagnosticStatusWrapper& report);
  void reportLatency(diagnostic_updater::DiagnosticStatusWrapper& report);

 private:
  using Clock = std::chrono::steady_clock;

  struct Counts {
    double seconds = 0.0;
    std::uint64_t arrived = 0;
    std::uint64_t dropped = 0;
    std::uint64_t lost = 0;
    std::uint64_t refused = 0;
    std::uint64_t skipped = 0;
    std::uint64_t matched = 0;
    std::uint64_t no_reference = 0;
    std::uint64_t ok = 0;
    std::uint64_t inliers = 0;
    double latency_sum = 0.0;
    double latency_max = 0.0;
    std::uint64_t overlays = 0;
    double overlay_sum = 0.0;  // ms
    std::uint64_t overlays_skipped = 0;

    void operator+=(const Counts& other);
  };

  Counts window() const;
  static double rate(const Counts& counts);
  /// Of a measured value and its upper limit, or of a lower limit and the measured value.
  unsigned char levelOf(double value, double limit) const;
  std::string matcherMessage(const Counts& counts, unsigned char& level) const;
  std::string inputMessage(const Counts& counts, unsigned char& level) const;

  mutable std::mutex mutex_;
  MonitorLimits limits_;
  Counts current_;
  Counts total_;
  std::array<Counts, 10> periods_;
  std::size_t next_period_ = 0;
  Clock::time_point period_start_ = Clock::now();
  std::string last_error_;  // of an image, as long as errors occur
  std::string parameter_error_;
  std::string lens_problem_;
  std::string reference_problem_;
  std::string mixture_;
  std::string input_trouble_;
  std::string topic_;
  bool listening_ = false;
  bool paused_ = false;
  bool clock_stands_ = false;
  bool clock_is_missing_ = false;
  Status last_status_ = Status::no_reference;
  Status last_failure_ = Status::ok;  // of a frame with a reference; ok: there was none
  NoReference last_reason_ = NoReference::none;
  std::uint64_t frames_without_reference_ = 0;  // consecutive, up to the last frame
};

}  // namespace ktgp_orb
