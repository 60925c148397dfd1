#pragma once

#include <CLI/CLI.hpp>

#include "parameters/parameters.h"
#include "tools/batch.h"

namespace ktgp_orb {

/// Adds --batch, --jobs and --part.
void addBatchOptions(CLI::App& app, BatchOptions& options);

/// To be called after parsing: the number of jobs, and the hash of all that decides the results:
/// the values of `parameters`, the contents of the files they name, and every other option. Throws
/// std::invalid_argument for names of outputs that are not below the folder of each recording.
void completeBatchOptions(CLI::App& app, const Parameters& parameters, BatchOptions& options);

}  // namespace ktgp_orb
