#pragma once

#include <ktgp_orb/KtgpConfig.h>

#include <CLI/CLI.hpp>

namespace ktgp_orb {

/// Adds an option for every parameter of the nodelet, with the text, range and default that
/// cfg/Ktgp.cfg gives it; `config` holds the defaults and receives the values.
void addParameterOptions(CLI::App& app, KtgpConfig& config);

}  // namespace ktgp_orb
