#include "files/jpeg_data.h"

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <vector>

namespace ktgp_orb::files {
namespace {

using Bytes = std::string_view;

std::size_t byteAt(Bytes bytes, std::size_t place) {
  return place < bytes.size() ? static_cast<unsigned char>(bytes[place]) : 0U;
}

std::size_t wordAt(Bytes bytes, std::size_t place) {
  return byteAt(bytes, place) << 8U | byteAt(bytes, place + 1);
}

/// Reads the bits of a scan, up to the next marker.
class Bits {
 public:
  Bits(Bytes bytes, std::size_t place) : bytes_(bytes), place_(place) {}

  /// The next bit; empty at a marker and at the end.
  std::optional<unsigned> next() {
    if (left_ == 0) {
      if (place_ >= bytes_.size()) return std::nullopt;
      value_ = static_cast<unsigned>(byteAt(bytes_, place_));
      if (value_ == 0xFF && byteAt(bytes_, place_ + 1) != 0) return std::nullopt;
      place_ += value_ == 0xFF ? 2 : 1;  // FF in the data is followed by a stuffed zero
      left_ = 8;
    }
    return value_ >> --left_ & 1U;
  }
  bool skip(std::size_t count) {
    while (count-- > 0) {
      if (!next()) return false;
    }
    return true;
  }
  /// Skips the rest of the byte and the restart marker after it; false if there is no marker.
  bool restart() {
    left_ = 0;
    const std::size_t marker = byteAt(bytes_, place_ + 1);
    if (byteAt(bytes_, place_) != 0xFF || marker < 0xD0 || marker > 0xD7) return false;
    place_ += 2;
    return true;
  }

 private:
  Bytes bytes_;
  std::size_t place_;
  unsigned value_ = 0;
  unsigned left_ = 0;
};

/// A Huffman table as in the file: the number of codes of each length, and the values of the codes.
struct Codes {
  std::array<std::size_t, 16> counts{};
  std::vector<std::size_t> meanings;

  std::optional<std::size_t> read(Bits& bits) const {
    std::size_t code = 0;
    std::size_t first = 0;
    std::size_t index = 0;
    for (const std::size_t count : counts) {
      const auto bit = bits.next();
      if (!bit) return std::nullopt;
      code = code << 1U | *bit;
      first <<= 1U;
      if (code < first + count && code >= first) {
        const std::size_t at = index + code - first;
        return at < meanings.size() ? std::make_optional(meanings[at]) : std::nullopt;
      }
      index += count;
      first += count;
    }
    return std::nullopt;
  }
};

struct Component {
  std::size_t id = 0;
  std::size_t columns = 1;  // width of a unit (MCU) in blocks
  std::size_t rows = 1;
  std::size_t tables = 0;  // numbers of the Huffman tables: 16 * DC table + AC table
};

/// The parts of a JPEG that are needed to count the units (MCUs) of a scan with all components.
struct Jpeg {
  std::array<Codes, 4> first_codes;
  std::array<Codes, 4> other_codes;
  std::vector<Component> components;
  std::size_t width = 0;
  std::size_t height = 0;
  std::size_t interval = 0;  // units between two restart markers; 0: no markers
  std::size_t scan = 0;      // position of the data of a scan with all components; 0: none
};

void readCodes(Bytes segment, Jpeg& jpeg) {
  std::size_t place = 0;
  while (place + 17 <= segment.size()) {
    const std::size_t kind = byteAt(segment, place++);
    Codes codes;
    std::size_t total = 0;
    for (std::size_t& count : codes.counts) total += count = byteAt(segment, place++);
    for (std::size_t i = 0; i < total; ++i) codes.meanings.push_back(byteAt(segment, place++));
    (kind >= 16 ? jpeg.other_codes : jpeg.first_codes)[kind % 4] = codes;
  }
}

void readFrame(Bytes segment, Jpeg& jpeg) {
  jpeg.height = wordAt(segment, 1);
  jpeg.width = wordAt(segment, 3);
  jpeg.components.resize(std::min<std::size_t>(byteAt(segment, 5), 4));
  std::size_t place = 6;
  for (Component& each : jpeg.components) {
    const std::size_t blocks = byteAt(segment, place + 1);
    each = {byteAt(segment, place), blocks >> 4U, blocks & 15U, 0};
    place += 3;
  }
  // If there is only one component, a unit is one block.
  if (jpeg.components.size() == 1) jpeg.components[0].columns = jpeg.components[0].rows = 1;
}

/// Reads the numbers of the Huffman tables. Returns whether the scan has all components.
bool readScan(Bytes segment, Jpeg& jpeg) {
  const std::size_t count = byteAt(segment, 0);
  if (count != jpeg.components.size()) return false;
  for (std::size_t i = 0; i < count; ++i) {
    const std::size_t id = byteAt(segment, 1 + 2 * i);
    for (Component& each : jpeg.components) {
      if (each.id == id) each.tables = byteAt(segment, 2 + 2 * i);
    }
  }
  return true;
}

/// Reads the segments before the first scan. `scan` is 0 if the units cannot be counted.
Jpeg parsed(Bytes bytes) {
  constexpr std::size_t kCodes = 0xC4, kScan = 0xDA, kInterval = 0xDD;
  Jpeg jpeg;
  std::size_t place = 2;
  while (place + 4 <= bytes.size() && byteAt(bytes, place) == 0xFF) {
    const std::size_t marker = byteAt(bytes, place + 1);
    if (marker == 0xFF) {  // padding
      ++place;
      continue;
    }
    const std::size_t length = std::max<std::size_t>(wordAt(bytes, place + 2), 2);
    const Bytes segment = bytes.substr(place + 4, length - 2);
    place += 2 + length;
    if (marker == kCodes) readCodes(segment, jpeg);
    if (marker == kInterval) jpeg.interval = wordAt(segment, 0);
    if (marker == 0xC0 || marker == 0xC1) readFrame(segment, jpeg);
    if (marker != kScan) continue;
    if (!jpeg.components.empty() && readScan(segment, jpeg)) jpeg.scan = place;
    break;
  }
  return jpeg;
}

bool readBlock(const Codes& first, const Codes& others, Bits& bits) {
  const auto size = first.read(bits);
  if (!size || !bits.skip(*size)) return false;
  for (std::size_t i = 1; i < 64; ++i) {
    const auto code = others.read(bits);
    if (!code) return false;
    const std::size_t zeros = *code >> 4U;
    const std::size_t length = *code & 15U;
    if (length == 0 && zeros < 15) break;
    i += zeros;
    if (!bits.skip(length)) return false;
  }
  return true;
}

bool readUnit(const Jpeg& jpeg, Bits& bits) {
  for (const Component& each : jpeg.components) {
    const Codes& first = jpeg.first_codes[each.tables / 16 % 4];
    const Codes& others = jpeg.other_codes[each.tables % 4];
    for (std::size_t i = 0; i < each.columns * each.rows; ++i) {
      if (!readBlock(first, others, bits)) return false;
    }
  }
  return true;
}

std::size_t unitsOf(const Jpeg& jpeg) {
  constexpr std::size_t kBlock = 8;  // px
  std::size_t columns = 1;
  std::size_t rows = 1;
  for (const Component& each : jpeg.components) {
    columns = std::max(columns, each.columns);
    rows = std::max(rows, each.rows);
  }
  const auto parts = [](std::size_t length, std::size_t part) {
    return (length + part - 1) / part;
  };
  return parts(jpeg.width, kBlock * columns) * parts(jpeg.height, kBlock * rows);
}

/// Whether any corner has the grey that decoders use for missing data. The picture may be rotated.
bool hasGreyCorner(const cv::Mat& picture) {
  constexpr std::uint8_t kFilled = 128;
  if (picture.empty() || picture.depth() != CV_8U) return false;
  for (const int row : {0, picture.rows - 1}) {
    for (const int column : {0, picture.cols - 1}) {
      const auto* const pixel = picture.ptr<std::uint8_t>(row, column);
      const auto* const end = pixel + picture.channels();
      if (std::all_of(pixel, end, [](std::uint8_t value) { return value == kFilled; })) return true;
    }
  }
  return false;
}

}  // namespace

bool lacksData(std::string_view bytes, const cv::Mat& picture) {
  if (bytes.substr(0, 3) != "\xFF\xD8\xFF" || !hasGreyCorner(picture)) return false;
  const Jpeg jpeg = parsed(bytes);
  if (jpeg.scan == 0) return false;
  Bits bits(bytes, jpeg.scan);
  const std::size_t units = unitsOf(jpeg);
  for (std::size_t i = 0; i < units; ++i) {
    if (i > 0 && jpeg.interval > 0 && i % jpeg.interval == 0 && !bits.restart()) return true;
    if (!readUnit(jpeg, bits)) return true;
  }
  return false;
}

}  // namespace ktgp_orb::files
