#pragma once

#include <cstddef>
#include <functional>
#include <string>

#include "tools/recording.h"

namespace ktgp_orb {

struct BatchOptions {
  std::string list;      ///< file with one recording per line
  std::string folder;    ///< of the outputs
  int jobs = 1;          ///< recordings processed in parallel, each in a process of its own
  std::size_t part = 1;  ///< of `parts`, from 1: the rows part, part + parts, ...
  std::size_t parts = 1;
  std::string parameters;  ///< hash of everything that decides the results
};

/// Processes one recording into a folder that exists; the same files whatever the machine.
using ProcessRecording =
    std::function<Outcome(const std::string& input, const std::string& folder)>;

/// Processes the recordings of a list into FOLDER/NAME/, where a folder appears only when all its
/// files are complete. Finished ones are skipped. A recording that fails is listed, and the others
/// go on; a full disk stops the batch. Without parts, FOLDER/summary.csv has a line for each row.
/// Returns the exit code of the program. Throws FileError.
int runBatch(const BatchOptions& options, const ProcessRecording& process);

/// "K/N". Throws std::invalid_argument.
void setPart(const std::string& text, BatchOptions& options);

}  // namespace ktgp_orb
