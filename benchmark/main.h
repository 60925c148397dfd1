#pragma once

namespace ktgp_orb::bench {

/// The main function of a benchmark program: runs the benchmarks that are registered, and those
/// that `registerMore` registers. With --instruction_set=NAME (a name of Highway, e.g. AVX2), the
/// kernels use no better set than this one. The result is 2, after a message that names the
/// possible sets, if this processor does not have it.
int run(int argc, char** argv, void (*registerMore)() = nullptr);

}  // namespace ktgp_orb::bench
