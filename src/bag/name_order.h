#pragma once

#include <string>
#include <vector>

namespace ktgp_orb::bag {

/// Sorts names of files by the numbers in them: "img2" before "img10", "-0.5" before "0.25",
/// "9.95" before "10.1". Whether "1.10" is a decimal or two counts is what all names together say:
/// counts have no zeros in front, and decimals that vary in length have none at their ends.
void sortByNumbers(std::vector<std::string>& files);

/// The names of `files` whose texts between the numbers are like those of almost no other file, for
/// example "thumbnail.png" beside "1.5.png", "2.png" and so on. Empty for fewer than four files.
std::vector<std::string> oddNames(const std::vector<std::string>& files);

}  // namespace ktgp_orb::bag
