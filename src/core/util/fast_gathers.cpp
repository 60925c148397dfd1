#include "core/util/fast_gathers.h"

#if defined(__x86_64__) || defined(__i386__)
#include <cpuid.h>
#endif

namespace ktgp_orb::util {

bool hasFastGathers() {
#if defined(__x86_64__) || defined(__i386__)
  unsigned a = 0;
  unsigned b = 0;
  unsigned c = 0;
  unsigned d = 0;
  constexpr unsigned kExtendedFeatures = 7;
  constexpr unsigned kAvx512Fp16 = 1U << 23;  // in register d
  return __get_cpuid_count(kExtendedFeatures, 0, &a, &b, &c, &d) != 0 && (d & kAvx512Fp16) != 0;
#else
  return false;
#endif
}

}  // namespace ktgp_orb::util
