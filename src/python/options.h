#pragma once

#include <pybind11/pybind11.h>

#include <memory>

#include "parameters/parameters.h"

namespace ktgp_orb::python {

/// Which parameters an object accepts: the parameters for matching a pair of images, or also the
/// parameters for a sequence.
enum class Scope { pair, sequence };

/// The constructor arguments of an object. They are stored so that pickle can make the same object
/// again.
struct Settings {
  pybind11::object preset;
  pybind11::kwargs changes;
};

/// The parameters of a preset, changed by keyword arguments such as T_w=0.8; doc/parameters.md
/// lists their names. T_w stays 0 if neither the preset nor a keyword sets it; pipelineOptions()
/// then chooses the default of the descriptor. Throws std::invalid_argument for an unknown preset
/// or parameter, a parameter that `scope` excludes, and a value that is out of range.
Parameters parametersFrom(const Settings& settings, Scope scope);

/// Defines __init__(preset, **parameters) and pickling for a class whose objects are made from
/// Settings. A pickled copy is a new object with the same settings.
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
