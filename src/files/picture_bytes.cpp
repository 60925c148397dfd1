#include "files/picture_bytes.h"

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <string>

namespace ktgp_orb::files {
namespace {

constexpr std::string_view kJpeg = "\xFF\xD8\xFF";
constexpr std::string_view kPng = "\x89PNG\r\n\x1A\n";

bool beginsWith(std::string_view bytes, std::string_view start) {
  return bytes.substr(0, start.size()) == start;
}

/// Reads a number of `size` bytes at `position`. Bytes beyond the end count as zero.
std::size_t numberAt(std::size_t position, std::size_t size, std::string_view bytes,
                     bool little_endian = false) {
  std::size_t number = 0;
  for (std::size_t i = 0; i < size; ++i) {
    const std::size_t at = position + (little_endian ? size - 1 - i : i);
    number = number << 8U | (at < bytes.size() ? static_cast<unsigned char>(bytes[at]) : 0U);
  }
  return number;
}

/// Looks in a JPEG for the first segment whose marker `wanted` accepts. Returns the position after
/// this marker; 0 if there is none. A JPEG consists of segments (a marker, a length that includes
/// itself, data) with compressed pixels between them. A byte FF among the pixels is followed by 0
/// or by a restart marker. A preview picture lies inside a segment, so its markers are skipped.
template <typename Wanted>
std::size_t segmentOf(std::string_view bytes, const Wanted& wanted) {
  std::size_t position = 2;
  while ((position = bytes.find('\xFF', position)) != std::string_view::npos) {
    const std::size_t marker = numberAt(++position, 1, bytes);
    if (marker == 0xFF) continue;  // FF is repeated as padding
    ++position;
    if (wanted(marker)) return position;
    const bool is_alone = marker <= 1 || (marker >= 0xD0 && marker <= 0xD7);
    if (!is_alone) position += numberAt(position, 2, bytes);
  }
  return 0;
}

/// Returns true if the PNG has a chunk with this name. Its chunks consist of length, name, data and
/// checksum.
bool hasChunk(std::string_view bytes, std::string_view name) {
  std::size_t position = kPng.size();
  while (position + 8 <= bytes.size()) {
    if (bytes.compare(position + 4, 4, name) == 0) return true;
    position += 12 + numberAt(position, 4, bytes);
  }
  return false;
}

std::optional<double> megapixels(std::size_t width, std::size_t height) {
  if (width == 0 || height == 0) return std::nullopt;
  return 1e-6 * static_cast<double>(width) * static_cast<double>(height);
}

std::optional<double> ofJpeg(std::string_view bytes) {
  const std::size_t frame = segmentOf(bytes, [](std::size_t marker) {
    const bool is_table = marker == 0xC4 || marker == 0xC8 || marker == 0xCC;
    return marker >= 0xC0 && marker <= 0xCF && !is_table;
  });
  if (frame == 0) return std::nullopt;
  return megapixels(numberAt(frame + 5, 2, bytes), numberAt(frame + 3, 2, bytes));
}

std::optional<double> ofBmp(std::string_view bytes) {
  const bool is_old = numberAt(14, 4, bytes, true) == 12;
  if (is_old) return megapixels(numberAt(18, 2, bytes, true), numberAt(20, 2, bytes, true));
  const auto side = [&](std::size_t at) {  // the height is negative if the top row comes first
    const auto number = static_cast<std::int32_t>(numberAt(at, 4, bytes, true));
    return static_cast<std::size_t>(std::abs(static_cast<std::int64_t>(number)));
  };
  return megapixels(side(18), side(22));
}

std::optional<double> ofWebp(std::string_view bytes) {
  const std::string_view kind = bytes.substr(std::min<std::size_t>(12, bytes.size()), 4);
  const auto part = [&](std::size_t at, unsigned shift, unsigned bits) {
    return numberAt(at, 4, bytes, true) >> shift & ((std::size_t{1} << bits) - 1);
  };
  if (kind == "VP8X") return megapixels(part(24, 0, 24) + 1, part(27, 0, 24) + 1);
  if (kind == "VP8L") return megapixels(part(21, 0, 14) + 1, part(21, 14, 14) + 1);
  if (kind == "VP8 ") return megapixels(part(26, 0, 14), part(28, 0, 14));
  return std::nullopt;
}

/// Megapixels of the picture or of one tile, whichever is larger. A decoder allocates whole tiles.
std::optional<double> ofTiff(std::string_view bytes) {
  constexpr std::size_t kWidth = 256, kHeight = 257, kTileWidth = 322, kTileHeight = 323;
  constexpr std::size_t kEntry = 12;
  const bool little = bytes[0] == 'I';
  const std::size_t directory = numberAt(4, 4, bytes, little);
  const std::size_t count = numberAt(directory, 2, bytes, little);
  const auto value = [&](std::size_t tag) -> std::size_t {
    for (std::size_t i = 0; i < count; ++i) {
      const std::size_t entry = directory + 2 + kEntry * i;
      if (numberAt(entry, 2, bytes, little) != tag) continue;
      const bool is_short = numberAt(entry + 2, 2, bytes, little) == 3;
      return numberAt(entry + 8, is_short ? 2 : 4, bytes, little);
    }
    return 0;
  };
  const auto picture = megapixels(value(kWidth), value(kHeight));
  const auto tile = megapixels(value(kTileWidth), value(kTileHeight));
  return picture && tile ? std::max(picture, tile) : picture;
}

}  // namespace

bool isCutOff(std::string_view bytes) {
  const auto ends = [](std::size_t marker) { return marker == 0xD9; };
  if (beginsWith(bytes, kJpeg)) return segmentOf(bytes, ends) == 0;
  return beginsWith(bytes, kPng) && !hasChunk(bytes, "IEND");
}

bool mayBeTransparent(std::string_view bytes) {
  constexpr std::size_t kKind = 25;  // position of a PNG's colour type, bytes
  constexpr std::size_t kOpacity = 4;
  if (beginsWith(bytes, kJpeg)) return false;
  return !beginsWith(bytes, kPng) || (numberAt(kKind, 1, bytes) & kOpacity) != 0 ||
         hasChunk(bytes, "tRNS");
}

std::optional<double> megapixelsOf(std::string_view bytes) {
  using namespace std::string_view_literals;
  if (beginsWith(bytes, kJpeg)) return ofJpeg(bytes);
  if (beginsWith(bytes, kPng)) return megapixels(numberAt(16, 4, bytes), numberAt(20, 4, bytes));
  if (beginsWith(bytes, "BM")) return ofBmp(bytes);
  if (beginsWith(bytes, "RIFF") && bytes.size() > 12) return ofWebp(bytes);
  if (beginsWith(bytes, "II*\0"sv) || beginsWith(bytes, "MM\0*"sv)) return ofTiff(bytes);
  return std::nullopt;
}

}  // namespace ktgp_orb::files
