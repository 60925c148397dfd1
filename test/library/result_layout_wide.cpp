// Compiled with flags for the widest vectors. It must contain nothing else: if the linker took an
// inline function from here, an older processor would crash.
#include "result_layout.h"

namespace ktgp_orb::test {

const LayoutEntry* layoutForWideVectors() {
  return kLayout;
}

}  // namespace ktgp_orb::test
