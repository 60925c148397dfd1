#pragma once

#include <diagnostic_updater/diagnostic_updater.h>

#include <cstdint>
#include <map>
#include <mutex>
#include <string>

namespace ktgp_orb {

/// Counts what a nodelet receives and publishes, and reports it to diagnostics. All functions may
/// be called from any thread.
class ConsumerMonitor {
 public:
  void setTopics(const std::string& image, const std::string& homography);
  void setListening(bool listening);

  void imageArrived();
  void homographyArrived(bool found);
  void dropped(std::size_t count);
  /// Images that were dropped because of max_memory.
  void forgotten(std::size_t count);
  void refused(const std::string& reason);
  /// A frame was processed.
  void done(double milliseconds);
  /// A problem that users should know; empty: none.
  void setWarning(const std::string& warning);
  /// Why the last change of parameters was refused; empty: it was accepted.
  void setParameterError(const std::string& error);
  /// That several nodes publish the images; empty: only one does.
  void setMixture(const std::string& mixture);
  /// Why images and homographies are missing; empty: not known.
  void setTroubles(const std::string& of_images, const std::string& of_homographies);
  /// Shown as it is.
  void setValue(const std::string& name, const std::string& value);

  std::uint64_t images() const;
  std::uint64_t homographies() const;
  std::uint64_t found() const;

  /// Call it once a second, before the reports. While the clock stands (a paused bag) nothing
  /// counts as missing.
  void tick(bool clock_stands);
  void report(diagnostic_updater::DiagnosticStatusWrapper& report);

 private:
  struct Counts {
    std::uint64_t images = 0;
    std::uint64_t homographies = 0;
    std::uint64_t found = 0;
    std::uint64_t dropped = 0;
    std::uint64_t forgotten = 0;
    std::uint64_t refused = 0;
    std::uint64_t done = 0;
    double milliseconds = 0.0;
  };

  /// With mutex_ locked.
  void summarise(diagnostic_updater::DiagnosticStatusWrapper& report) const;

  mutable std::mutex mutex_;
  std::string image_topic_;
  std::string homography_topic_;
  bool listening_ = false;
  int silent_images_ = 0;  // s
  int silent_homographies_ = 0;
  Counts total_;
  Counts before_;  // at the last tick
  Counts last_;    // in the last period
  std::string refusal_;
  std::string warning_;
  std::string parameter_error_;
  std::string mixture_;
  std::string image_trouble_;
  std::string homography_trouble_;
  bool clock_stands_ = false;
  std::map<std::string, std::string> values_;
};

}  // namespace ktgp_orb
