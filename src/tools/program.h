#pragma once

#include <cstddef>
#include <functional>
#include <mutex>
#include <string>

namespace ktgp_orb::tools {

/// Exit codes of all programs.
constexpr int kExitDone = 0;           ///< everything was done
constexpr int kExitUnusedData = 1;     ///< some data could not be used; messages say which
constexpr int kExitUnusable = 2;       ///< options, inputs or outputs cannot be used
constexpr int kExitInterrupted = 130;  ///< interrupted (Ctrl-C); shells use the same code

/// The exit codes as text for --help.
constexpr const char* kExitCodes =
    "Exit code: 0 done, 1 some of the data could not be used (it is named), 2 options, inputs or\n"
    "outputs cannot be used, 130 interrupted (Ctrl-C).";

/// Runs `program` and returns its exit code. If `program` throws or its output cannot be written,
/// prints a message that begins with `name` and returns kExitUnusable.
int runProgram(const char* name, const std::function<int()>& program);

/// After this call, Ctrl-C, SIGTERM and SIGHUP (the terminal was closed) do not end the program,
/// but make interrupted() return true. For programs that complete their files before they end.
void stopWhenInterrupted();
bool interrupted();

/// After this call, these signals end the program at once with kExitInterrupted. For programs that
/// write their files only at the end.
void exitWhenInterrupted();

/// A progress bar or a status line on stderr; shown only if stderr is a terminal. Thread-safe.
class ProgressBar {
 public:
  /// `total`: number of items. If it is 0, the number is unknown, and only the count is shown.
  explicit ProgressBar(std::size_t total);
  /// Removes the bar from the terminal.
  ~ProgressBar();
  ProgressBar(const ProgressBar&) = delete;
  ProgressBar& operator=(const ProgressBar&) = delete;

  /// Counts one more item and shows the text `what` beside the bar.
  void advance(const std::string& what);
  /// Shows the text `what` without a bar.
  void say(const std::string& what);

 private:
  std::mutex mutex_;
  std::size_t total_;
  std::size_t done_ = 0;
  bool shown_;
};

}  // namespace ktgp_orb::tools
