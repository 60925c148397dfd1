#pragma once

#include <optional>
#include <string_view>

namespace ktgp_orb::files {

/// Returns true if the bytes are a JPEG or PNG that is cut off, that is, without its end marker.
/// Libraries decode such a JPEG anyway and fill the missing part with grey. More bytes after the
/// end marker do no harm.
bool isCutOff(std::string_view bytes);

/// Returns false if the picture certainly has no transparent pixels: a JPEG, or a PNG without
/// alpha. Returns true for all other formats.
bool mayBeTransparent(std::string_view bytes);

/// Megapixels of a JPEG, PNG, TIFF, WebP or BMP. Reads them from the header, so that a picture can
/// be refused before memory is allocated for it. Empty for other formats and for a damaged header.
std::optional<double> megapixelsOf(std::string_view bytes);

}  // namespace ktgp_orb::files
