#pragma once

namespace ktgp_orb::bench {

/// Takes --instruction_set=NAME (a name of Highway, e.g. AVX2) out of the arguments, if it is
/// there. The kernels then use no better set than this one. Returns false, after a message that
/// names the possible ones, if this processor does not have it. Call it before anything else of the
/// package.
bool limitInstructionSet(int& argc, char** argv);

/// The rest of a main function: runs all benchmarks that are registered.
int runBenchmarks(int argc, char** argv);

}  // namespace ktgp_orb::bench
