#pragma once

#include <string>

namespace ktgp_orb::files {

/// Whether the file is a JPEG or PNG without its end. Libraries decode such a JPEG with grey in
/// place of what is missing, and print what they think of it. Bytes after the end do not matter.
bool isCutOff(const std::string& file);

}  // namespace ktgp_orb::files
