#pragma once

#include <pybind11/pybind11.h>

#include <memory>

#include "parameters/parameters.h"

namespace ktgp_orb::python {

/// Which parameters an object obeys.
enum class Scope { pair, sequence };

/// How an object was made, for pickle.
struct Settings {
  pybind11::object preset;
  pybind11::kwargs changes;
};

/// The parameters of a preset, changed by keywords with the names of doc/parameters.md, e.g.
/// T_w=0.8. If the descriptor changes and T_w is not given, T_w is the default of the new one.
/// Throws std::invalid_argument for an unknown preset or name, a name that `scope` does not obey,
/// and a value out of its range.
Parameters parametersFrom(const Settings& settings, Scope scope);

/// Defines __init__(preset, **parameters) of a class whose objects are made from Settings, and
/// pickle: the copy is as new, with the same settings.
template <typename Class>
void defineSettings(Class& object, const char* usual_preset, const char* text) {
  namespace py = pybind11;
  using Type = typename Class::type;
  object
      .def(py::init([](const py::object& preset, const py::kwargs& changes) {
             return std::make_unique<Type>(Settings{preset, changes});
           }),
           py::arg("preset") = usual_preset, text)
      .def(py::pickle(
          [](const Type& made) {
            return py::make_tuple(made.settings.preset, made.settings.changes);
          },
          [](const py::tuple& state) {
            return std::make_unique<Type>(Settings{state[0], state[1].template cast<py::kwargs>()});
          }));
}

}  // namespace ktgp_orb::python
