#include "files/picture_end.h"

#include <cstddef>
#include <fstream>
#include <iterator>

namespace ktgp_orb::files {
namespace {

constexpr char kJpeg[] = "\xFF\xD8\xFF";
constexpr char kPng[] = "\x89PNG\r\n\x1A\n";

bool beginsWith(const std::string& start, const std::string& bytes) {
  return bytes.compare(0, start.size(), start) == 0;
}

/// Big-endian; zero beyond the end.
std::size_t numberAt(std::size_t position, std::size_t size, const std::string& bytes) {
  std::size_t number = 0;
  for (std::size_t i = position; i < position + size && i < bytes.size(); ++i) {
    number = number << 8U | static_cast<unsigned char>(bytes[i]);
  }
  return number;
}

/// Segments of a marker, a length that counts itself, and data, with compressed pixels between
/// them, where FF is followed by 0 or by the number of a restart. A preview is in a segment.
bool jpegEnds(const std::string& bytes) {
  constexpr std::size_t kEnd = 0xD9;
  std::size_t position = 2;
  while ((position = bytes.find('\xFF', position)) != std::string::npos) {
    const std::size_t marker = numberAt(++position, 1, bytes);
    if (marker == kEnd) return true;
    if (marker == 0xFF) continue;  // filling
    ++position;
    const bool is_alone = marker <= 1 || (marker >= 0xD0 && marker <= 0xD7);
    if (!is_alone) position += numberAt(position, 2, bytes);
  }
  return false;
}

/// Chunks of a length, a name, data and a checksum.
bool pngEnds(const std::string& bytes) {
  std::size_t position = sizeof kPng - 1;
  while (position + 8 <= bytes.size()) {
    if (bytes.compare(position + 4, 4, "IEND") == 0) return true;
    position += 12 + numberAt(position, 4, bytes);
  }
  return false;
}

}  // namespace

bool isCutOff(const std::string& file) {
  std::ifstream in(file, std::ios::binary);
  std::string bytes(sizeof kPng - 1, '\0');
  in.read(bytes.data(), static_cast<std::streamsize>(bytes.size()));
  const bool jpeg = beginsWith(kJpeg, bytes);
  const bool png = beginsWith(kPng, bytes);
  if (!in || (!jpeg && !png)) return false;
  bytes.append(std::istreambuf_iterator<char>(in), {});
  return jpeg ? !jpegEnds(bytes) : !pngEnds(bytes);
}

}  // namespace ktgp_orb::files
