#pragma once

#include <functional>

namespace ktgp_orb::tools {

/// Exit codes of all programs.
constexpr int kExitDone = 0;           ///< everything was done
constexpr int kExitUnusedData = 1;     ///< some of the data could not be used; messages name it
constexpr int kExitUnusable = 2;       ///< options, inputs or outputs cannot be used
constexpr int kExitInterrupted = 130;  ///< Ctrl-C, as a shell reports it

/// The same as text for --help.
constexpr const char* kExitCodes =
    "Exit code: 0 done, 1 some of the data could not be used (it is named), 2 options, inputs or\n"
    "outputs cannot be used, 130 interrupted (Ctrl-C).";

/// "ktgp_orb 0.1.0"
const char* version();

/// Runs `program` and returns its exit code. Returns kExitUnusable, after a message that begins
/// with `name`, if it throws or if its output could not be written.
int runProgram(const char* name, const std::function<int()>& program);

/// After this call, Ctrl-C, SIGTERM and SIGHUP (a closed terminal) set interrupted(), for programs
/// that then complete their files.
void stopWhenInterrupted();
bool interrupted();

/// These signals end the program at once with kExitInterrupted. For programs that write their files
/// at the end.
void exitWhenInterrupted();

}  // namespace ktgp_orb::tools
