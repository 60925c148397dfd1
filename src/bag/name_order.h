#pragma once

#include <string>
#include <vector>

namespace ktgp_orb::bag {

/// Sorts file names by the numbers in them: "img2" before "img10", "-0.5" before "0.25", "9.95"
/// before "10.1". Looks at all names to decide whether "1.10" is a decimal or two counters:
/// counters have no leading zeros, and decimals of different lengths have no trailing zeros.
void sortByNumbers(std::vector<std::string>& files);

/// Returns the names that differ from nearly all others in more than their numbers, for example
/// "thumbnail.png" beside "1.5.png", "2.png" and so on. Empty for fewer than four files.
std::vector<std::string> oddNames(const std::vector<std::string>& files);

/// Detects two or more series of names that alternate in the sorted `files`. If so, returns two
/// neighbours from different series, for example "1_left.png" and "1_right.png" if "2_left.png"
/// follows. Otherwise returns nothing.
std::vector<std::string> alternatingNames(const std::vector<std::string>& files);

}  // namespace ktgp_orb::bag
