#pragma once

#include <diagnostic_updater/diagnostic_updater.h>

#include <chrono>
#include <cstdint>
#include <map>
#include <mutex>
#include <string>

#include "messages/ground_readings.h"

namespace ktgp_orb {

/// Why the ground motion publishes nothing, and what its diagnostics report. problemOf() belongs to
/// one thread; the other functions may be called from any.
class GroundMonitor {
 public:
  /// Why nothing is published for a frame; empty: it is. `patience`: s, see the parameter.
  std::string problemOf(const GroundEstimate& estimate, const GroundReadings& readings,
                        const ros::Time& stamp, double patience);

  void setListening(bool listening, const std::string& topic, const std::string& trouble);
  void setEstimate(const GroundEstimate& estimate, double plane_deviation);
  /// A match was processed; `problem`: why nothing was published.
  void done(const std::string& problem, std::chrono::steady_clock::duration time);
  std::uint64_t matches() const;
  void report(diagnostic_updater::DiagnosticStatusWrapper& report);

 private:
  ros::Time last_height_;  // that was used
  ros::Time last_normal_;

  mutable std::mutex mutex_;  // guards what follows
  bool listening_ = false;
  std::string topic_;
  std::string trouble_;
  std::string problem_;
  std::string not_used_;
  std::string sources_;
  std::map<std::string, double> numbers_;
  std::string status_;
  std::uint64_t matches_ = 0;
  std::uint64_t matches_before_ = 0;  // at the last report
  std::uint64_t published_ = 0;
};

}  // namespace ktgp_orb
