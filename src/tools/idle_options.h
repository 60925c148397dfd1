#pragma once

#include <CLI/CLI.hpp>

#include "parameters/parameters.h"

namespace ktgp_orb {

/// Throws std::invalid_argument for options of ktgp_bag that would be accepted without effect.
void refuseIdleOptions(const CLI::App& app, const Parameters& parameters);

}  // namespace ktgp_orb
