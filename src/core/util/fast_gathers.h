#pragma once

namespace ktgp_orb::util {

/// Whether instructions that gather values from memory are faster than reading them one by one: on
/// Intel processors with AVX-512 FP16 (Sapphire Rapids and later). Other processors take up to four
/// times as long, among them older ones from Intel, whose microcode slows gathers down for security
/// (Downfall).
bool hasFastGathers();

}  // namespace ktgp_orb::util
