#pragma once

#include <diagnostic_updater/diagnostic_updater.h>
#include <ktgp_orb/TargetDetections.h>

#include <cstdint>
#include <mutex>
#include <string>

namespace ktgp_orb {

/// What the targets nodelet does, for the diagnostics. All functions may be called from any thread.
class TargetsMonitor {
 public:
  /// `image_trouble`: why no images arrive; empty: not known.
  void setListening(bool listening, const std::string& image_trouble);
  void imageArrived();
  void refused(const std::string& reason);
  void done(const TargetDetections& message);
  /// Targets that were refused since the start, and why the last one was.
  void targetRefused(const std::string& reason);
  /// Number of targets that are still to be read.
  void setWaiting(std::size_t count);

  std::uint64_t images() const;
  void report(diagnostic_updater::DiagnosticStatusWrapper& report);

 private:
  mutable std::mutex mutex_;
  bool listening_ = false;
  std::string image_trouble_;
  std::uint64_t images_ = 0;
  std::uint64_t refused_images_ = 0;
  std::string refusal_;  // of the last image; empty: it was used
  std::uint64_t refused_targets_ = 0;
  std::string target_refusal_;
  std::string ambiguous_;  // a target of the last image that is
  std::size_t waiting_ = 0;
  TargetDetections last_;  // the last one, without detections
  std::size_t found_ = 0;
};

}  // namespace ktgp_orb
