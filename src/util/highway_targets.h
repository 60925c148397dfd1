#pragma once

// Defines the instruction sets for vector code: all sets that Highway knows, except the sets that
// are excluded here. Include this before any header of Highway.
//
// Each vectorised loop is written twice: in plain C++ as the reference, and with Highway in a file
// *-inl.h. dispatch.cpp includes these files once for each instruction set, puts the functions into
// a struct, and chooses one struct at run time. Tests compare each struct with the plain loops.

// Also compile for AVX-512 with BITALG and VPOPCNTDQ (Ice Lake, Zen 4). By default, Highway 1.0
// does not.
#define HWY_WANT_AVX3_DL 1
// Exclude SVE and RVV, because we put vectors into arrays, which is impossible if the compiler does
// not know their size; processors with SVE also have NEON. Exclude SSSE3, because nearly every
// processor that has it also has a later set.
#define HWY_DISABLED_TARGETS (HWY_SSSE3 | HWY_SVE | HWY_SVE2 | HWY_SVE_256 | HWY_SVE2_128 | HWY_RVV)

// 1 if the instruction set has vectors. Without vectors (riscv64, s390x), the plain loops run: they
// are faster than Highway's emulation of vectors, which GCC before 12.3 cannot even compile. Use
// this after foreach_target.h.
#define KTGP_ORB_HAS_VECTORS (HWY_TARGET != HWY_SCALAR && HWY_TARGET != HWY_EMU128)
