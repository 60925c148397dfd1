#pragma once

#include <cstddef>
#include <string>

namespace ktgp_orb::files {

/// Number of pages of a TIFF file. Smaller copies of a page, as maps have them (overviews), and
/// masks do not count. 1 for other files and for damaged ones.
std::size_t pagesIn(const std::string& file);

/// The text for users "FILE: has 5 pages; only the first is used". Empty if there is only one.
std::string noteOnPages(const std::string& file);

}  // namespace ktgp_orb::files
