#pragma once

// Defines the instruction sets for vector code: all sets that Highway knows, except the sets that
// are excluded here. Include this before any header of Highway.
//
// Each vectorised loop is written twice: in plain C++ as the reference, and with Highway in a file
// *-inl.h. dispatch.cpp includes these files once for each instruction set, puts the functions into
// a struct, and chooses one struct at run time. Tests compare each struct with the plain loops.

// Includes AVX-512 with BITALG and VPOPCNTDQ (Ice Lake, Zen 4), which Highway 1.0 leaves out by
// default.
#define HWY_WANT_AVX3_DL 1
// SVE and RVV are excluded because vectors of unknown size cannot be put into arrays; processors
// with SVE also have NEON. SSSE3 is excluded because processors without a later set are too rare.
#define HWY_DISABLED_TARGETS (HWY_SSSE3 | HWY_SVE | HWY_SVE2 | HWY_SVE_256 | HWY_SVE2_128 | HWY_RVV)

// Whether an instruction set has vectors. Without vectors (riscv64, s390x) the plain loops run,
// because Highway's emulation of vectors is slower, and GCC before 12.3 does not compile it. Use
// this after foreach_target.h.
#define KTGP_ORB_HAS_VECTORS (HWY_TARGET != HWY_SCALAR && HWY_TARGET != HWY_EMU128)
