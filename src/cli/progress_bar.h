#pragma once

#include <cstddef>
#include <mutex>
#include <string>

namespace ktgp_orb::tools {

/// A progress bar or a status line on stderr, only on a terminal. Can be used from several threads.
class ProgressBar {
 public:
  /// `total` 0: not known; only the count is shown.
  explicit ProgressBar(std::size_t total);
  /// Removes the bar.
  ~ProgressBar();
  ProgressBar(const ProgressBar&) = delete;
  ProgressBar& operator=(const ProgressBar&) = delete;

  /// Counts one more; `what` is shown beside the bar.
  void advance(const std::string& what);
  /// Shows `what` alone.
  void say(const std::string& what);

 private:
  std::mutex mutex_;
  std::size_t total_;
  std::size_t done_ = 0;
  bool shown_;
};

}  // namespace ktgp_orb::tools
