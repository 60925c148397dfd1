#pragma once

#include <optional>
#include <string_view>

namespace ktgp_orb::files {

/// Whether the bytes are a JPEG or PNG that is cut off. Libraries decode such a JPEG and fill the
/// missing part with grey. Bytes after the end do not matter.
bool isCutOff(std::string_view bytes);

/// Whether a picture may be transparent; false only for a JPEG, and for a PNG without alpha.
bool mayBeTransparent(std::string_view bytes);

/// Megapixels of a JPEG, PNG, TIFF, WebP or BMP, read from its header before any memory is reserved
/// for the pixels; empty for other formats and for a damaged header.
std::optional<double> megapixelsOf(std::string_view bytes);

}  // namespace ktgp_orb::files
