#pragma once

#include <optional>
#include <string_view>

namespace ktgp_orb::files {

/// Whether the bytes are a JPEG or PNG that is cut off. Libraries decode such a JPEG and fill the
/// missing part with grey. Bytes after the end do not matter.
bool isCutOff(std::string_view bytes);

/// Megapixels of a JPEG, PNG, TIFF, WebP or BMP according to its header, so that the size is known
/// before memory is allocated. Empty for other formats and for a damaged header.
std::optional<double> megapixelsOf(std::string_view bytes);

}  // namespace ktgp_orb::files
