#include "files/tiff_pages.h"

#include <algorithm>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <set>
#include <system_error>

#include "util/printable.h"

namespace ktgp_orb::files {
namespace {

/// Reads the numbers of a TIFF file, which have the byte order of the machine that wrote it.
class TiffReader {
 public:
  explicit TiffReader(const std::string& file) : in_(file, std::ios::binary) {
    std::string order(2, '\0');
    in_.read(order.data(), 2);
    is_little_ = order == "II";
    is_tiff_ = is_little_ || order == "MM";
  }

  bool isTiff() const { return is_tiff_; }
  /// False after a read beyond the end of the file.
  bool isGood() const { return in_.good(); }
  void goTo(std::uint64_t position) { in_.seekg(static_cast<std::streamoff>(position)); }
  void skip(int bytes) { in_.seekg(bytes, std::ios::cur); }

  std::uint64_t number(int bytes) {
    std::uint64_t value = 0;
    for (int i = 0; i < bytes; ++i) {
      const auto byte = static_cast<std::uint64_t>(static_cast<std::uint8_t>(in_.get()));
      value = is_little_ ? value | byte << (8 * i) : value << 8 | byte;
    }
    return value;
  }

 private:
  std::ifstream in_;
  bool is_little_ = false;
  bool is_tiff_ = false;
};

/// Sizes of the fields, bytes: a BigTIFF has the larger ones.
struct Sizes {
  int entries;  ///< number of entries of a directory
  int offset;   ///< position in the file
  int rest;     ///< type, count and value: an entry without its tag
};

constexpr Sizes kTiff{2, 4, 10};
constexpr Sizes kBigTiff{8, 8, 18};

/// Reads the directory of a page and leaves the reader behind it. Returns false for a smaller copy
/// and for a mask.
bool isPage(const Sizes& sizes, TiffReader& tiff) {
  constexpr std::uint64_t kSubfileType = 254;
  constexpr std::uint64_t kSmallerOrMask = 1 | 4;
  constexpr std::uint64_t kMostEntries = 4096;
  bool is_page = true;
  const std::uint64_t entries = std::min(tiff.number(sizes.entries), kMostEntries);
  for (std::uint64_t i = 0; i < entries && tiff.isGood(); ++i) {
    if (tiff.number(2) != kSubfileType) {
      tiff.skip(sizes.rest);
      continue;
    }
    tiff.skip(sizes.rest - sizes.offset);
    is_page = (tiff.number(4) & kSmallerOrMask) == 0;
    tiff.skip(sizes.offset - 4);
  }
  return is_page;
}

}  // namespace

std::size_t pagesIn(const std::string& file) {
  std::error_code none;
  if (!std::filesystem::is_regular_file(file, none)) return 1;
  TiffReader tiff(file);
  if (!tiff.isTiff()) return 1;
  const std::uint64_t version = tiff.number(2);
  if (version != 42 && version != 43) return 1;
  const Sizes& sizes = version == 42 ? kTiff : kBigTiff;
  if (version == 43) tiff.skip(4);  // the size of positions: 8 and 0
  constexpr std::size_t kMost = 10000;
  std::size_t pages = 0;
  std::set<std::uint64_t> seen;  // a damaged file may be a circle
  std::uint64_t next = tiff.number(sizes.offset);
  while (next != 0 && tiff.isGood() && pages < kMost && seen.insert(next).second) {
    tiff.goTo(next);
    const bool is_page = isPage(sizes, tiff);
    next = tiff.number(sizes.offset);
    if (tiff.isGood() && is_page) ++pages;
  }
  return std::max<std::size_t>(pages, 1);
}

std::string noteOnPages(const std::string& file) {
  const std::size_t pages = pagesIn(file);
  if (pages < 2) return {};
  return util::printable(file) + ": has " + std::to_string(pages) +
         " pages; only the first is used";
}

}  // namespace ktgp_orb::files
