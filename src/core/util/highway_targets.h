#pragma once

// The instruction sets that vector code is compiled for: all that Highway knows, but for those
// left out here. To be included before any header of Highway's.
//
// How vector code is written: the loops stand twice, in plain C++ as the definition and with
// Highway in a file that foreach_target.h includes once for each instruction set. HWY_EXPORT and
// HWY_DYNAMIC_DISPATCH choose among them when the program runs. What is chosen is a struct of
// functions with the name of its instruction set. Tests hold each of them to the plain loops.

// AVX-512 with BITALG and VPOPCNTDQ (Ice Lake, Zen 4), which Highway 1.0 leaves out unless asked.
#define HWY_WANT_AVX3_DL 1
// Vectors of unknown size fit no arrays, and processors with SVE have NEON as well. Processors of
// SSSE3 alone are not worth their code.
#define HWY_DISABLED_TARGETS (HWY_SSSE3 | HWY_SVE | HWY_SVE2 | HWY_SVE_256 | HWY_SVE2_128 | HWY_RVV)

// Whether an instruction set has vectors; without, the plain loops are the better ones. For use
// below foreach_target.h.
#define KTGP_ORB_HAS_VECTORS (HWY_TARGET != HWY_SCALAR && HWY_TARGET != HWY_EMU128)
