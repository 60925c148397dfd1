#pragma once

#include <optional>
#include <string_view>

namespace ktgp_orb::files {

/// Whether the bytes are a JPEG or PNG that is cut off. Libraries decode such a JPEG and fill the
/// missing part with grey. Bytes after the end do not matter.
bool isCutOff(std::string_view bytes);

/// Whether a picture may have opacity; false only for a JPEG, and for a PNG without it.
bool mayBeTransparent(std::string_view bytes);

/// Megapixels of a JPEG, PNG, TIFF, WebP or BMP as its header says, before any memory is reserved
/// for them; empty for anything else, and for a damaged header.
std::optional<double> megapixelsOf(std::string_view bytes);

}  // namespace ktgp_orb::files
