#include "python/match.h"

// This macro defines PyInit_checked(). Python calls PyInit_ktgp_orb_core() below, which then calls
// PyInit_checked().
PYBIND11_MODULE(checked, module) {
  module.attr("__name__") = "ktgp_orb_core";
  module.attr("__version__") = KTGP_ORB_VERSION;
  module.doc() =
      "How one image maps onto another: KTGP-ORB features, matches and homographies.\n\n"
      "    import cv2, ktgp_orb_core as ktgp\n"
      "    found = ktgp.match(cv2.imread('a.png'), cv2.imread('b.png'), preset='robust')\n"
      "    print(found.status, found.homography)\n\n"
      "Results have the same bits as those of the C++ library. Errors raise ValueError.";
  ktgp_orb::python::definePairs(module);
  ktgp_orb::python::defineSequence(module);
  ktgp_orb::python::defineConsumers(module);
}

/// Raises ImportError in a sub-interpreter, because pybind11 would wait forever there.
// NOLINTNEXTLINE(readability-identifier-naming): the name that Python looks for
extern "C" PYBIND11_EXPORT PyObject* PyInit_ktgp_orb_core() {
  if (PyThreadState_Get()->interp != PyInterpreterState_Main()) {
    PyErr_SetString(PyExc_ImportError,
                    "ktgp_orb_core works in the main interpreter alone; expected an import there, "
                    "or another process");
    return nullptr;
  }
  return PyInit_checked();
}
