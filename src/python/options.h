#pragma once

#include <pybind11/pybind11.h>

#include <string>

#include "parameters/parameters.h"

namespace ktgp_orb::python {

/// Which parameters an object obeys.
enum class Scope { pair, sequence };

/// The parameters of a preset, changed by keywords with the names of doc/parameters.md, e.g.
/// T_w=0.8. If the descriptor changes and T_w is not given, T_w is the default of the new one.
/// Throws std::invalid_argument for an unknown preset or name, a name that `scope` does not obey,
/// and a value out of its range.
Parameters parametersFrom(const std::string& preset, const pybind11::kwargs& changes, Scope scope);

}  // namespace ktgp_orb::python
