// Compiled with the flags of a user who builds for the widest vectors. Nothing else may be in here:
// an inline function that the linker takes from here would crash an older processor.
#include "result_layout.h"

namespace ktgp_orb::test {

const LayoutEntry* layoutForWideVectors() {
  return kLayout;
}

}  // namespace ktgp_orb::test
