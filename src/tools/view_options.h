#pragma once

#include <CLI/CLI.hpp>

#include "tools/bag_views.h"

namespace ktgp_orb {

/// Adds --stabilize, --mosaic and what belongs to them.
void addViewOptions(CLI::App& app, ViewOptions& views);
/// To be called after parsing. Throws std::invalid_argument for options that this build cannot
/// fulfil.
void completeViewOptions(const CLI::App& app, ViewOptions& views, bool force);

}  // namespace ktgp_orb
