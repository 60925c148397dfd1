#pragma once

#include <string>
#include <vector>

namespace ktgp_orb::bag {

/// Sorts file names by the numbers in them: "img2" before "img10", "-0.5" before "0.25", "9.95"
/// before "10.1". Decides from all names whether "1.10" is a decimal or two counters: counters have
/// no leading zeros, and decimals of different lengths have no trailing zeros.
void sortByNumbers(std::vector<std::string>& files);

/// Names in `files` whose text around the numbers is shared by almost no other file, for example
/// "thumbnail.png" beside "1.5.png", "2.png" and so on. Empty for fewer than four files.
std::vector<std::string> oddNames(const std::vector<std::string>& files);

/// If two or more series of names alternate in sorted `files`, returns two neighbours from
/// different series: "1_left.png" and "1_right.png", if "2_left.png" follows. Otherwise returns
/// nothing.
std::vector<std::string> alternatingNames(const std::vector<std::string>& files);

}  // namespace ktgp_orb::bag
