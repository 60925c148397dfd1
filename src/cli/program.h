#pragma once

#include <functional>

namespace ktgp_orb::tools {

/// What every program's exit code means.
constexpr int kExitDone = 0;           ///< all that was asked for is done
constexpr int kExitUnusedData = 1;     ///< some of the data could not be used; it is named
constexpr int kExitUnusable = 2;       ///< options, inputs or outputs cannot be used
constexpr int kExitInterrupted = 130;  ///< Ctrl-C, as a shell reports it

/// The same in the words of --help.
constexpr const char* kExitCodes =
    "Exit code: 0 done, 1 some of the data could not be used (it is named), 2 options, inputs or\n"
    "outputs cannot be used, 130 interrupted (Ctrl-C).";

/// Runs `program` and returns its exit code, or kExitUnusable after a message that begins with
/// `name`: where it throws, and where what it printed could not be written.
int runProgram(const char* name, const std::function<int()>& program);

/// From now on Ctrl-C, SIGTERM and SIGHUP (a closed terminal) set interrupted(), for programs that
/// then finish what they write.
void stopWhenInterrupted();
bool interrupted();

/// The same signals end the program at once with kExitInterrupted. For programs that write their
/// files at the end.
void exitWhenInterrupted();

}  // namespace ktgp_orb::tools
