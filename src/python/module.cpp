#include "python/match.h"

PYBIND11_MODULE(ktgp_orb_core, module) {
  module.doc() =
      "How one image maps onto another: KTGP-ORB features, matches and homographies.\n\n"
      "    import cv2, ktgp_orb_core as ktgp\n"
      "    found = ktgp.match(cv2.imread('a.png'), cv2.imread('b.png'), preset='robust')\n"
      "    print(found.status, found.homography)\n\n"
      "Results have the same bits as those of the C++ library. Errors raise ValueError.";
  ktgp_orb::python::definePairs(module);
  ktgp_orb::python::defineSequence(module);
}
