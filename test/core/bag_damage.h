#pragma once

#include <algorithm>
#include <cstdint>
#include <cstring>
#include <random>
#include <string>
#include <utility>
#include <vector>

namespace ktgp_orb::test {

using FileBytes = std::vector<std::uint8_t>;

/// Damages the bytes of an intact bag in many ways. Damage number `n` is always the same.
class BagDamage {
 public:
  explicit BagDamage(FileBytes sound) : sound_(std::move(sound)) { findRecords(); }

  /// The damaged bytes; `what` describes the damage.
  FileBytes make(std::uint64_t n, std::string& what) const {
    std::mt19937_64 random(n);
    FileBytes bytes = sound_;
    // First a cut at every boundary of records, then random kinds.
    if (n < boundaries_.size()) return cut(bytes, boundaries_[n], what);
    using Kind = void (BagDamage::*)(FileBytes&, std::mt19937_64&, std::string&) const;
    constexpr Kind kKinds[] = {&BagDamage::flipAnywhere,  &BagDamage::flipInHeader,
                               &BagDamage::flipInHeader,  &BagDamage::falsifyLength,
                               &BagDamage::falsifyLength, &BagDamage::cutAnywhere,
                               &BagDamage::swapRecords,   &BagDamage::overwrite,
                               &BagDamage::removePart,    &BagDamage::repeatPart};
    const auto kind = kKinds[random() % std::size(kKinds)];
    (this->*kind)(bytes, random, what);
    if (random() % 8 == 0) flipInHeader(bytes, random, what);  // a second one
    return bytes;
  }

 private:
  struct Record {
    std::size_t begin;  ///< the length of the header
    std::size_t data;   ///< the length of the data precedes it
    std::size_t end;
    bool chunk;
  };

  std::uint32_t numberAt(std::size_t i) const {
    std::uint32_t number = 0;
    std::memcpy(&number, &sound_[i], 4);
    return number;
  }

  void findRecords() {
    addRecords(13, sound_.size());
    boundaries_.push_back(0);
    for (const Record& record : records_) {
      for (const std::size_t place : {record.begin, record.begin + 4, record.data, record.end}) {
        boundaries_.push_back(place);
        if (place > 0) boundaries_.push_back(place - 1);
      }
    }
    std::sort(boundaries_.begin(), boundaries_.end());
    boundaries_.erase(std::unique(boundaries_.begin(), boundaries_.end()), boundaries_.end());
    boundaries_.pop_back();  // the whole file
  }

  /// Including those within uncompressed chunks.
  void addRecords(std::size_t begin, std::size_t end) {
    while (begin + 8 <= end) {
      const std::size_t data = begin + 8 + numberAt(begin);
      if (data > end) return;
      Record record{begin, data, data + numberAt(data - 4), false};
      const std::string header(&sound_[begin], &sound_[data]);
      record.chunk = header.find("compression=") != std::string::npos;
      records_.push_back(record);
      if (header.find("compression=none") != std::string::npos) addRecords(data, record.end);
      begin = record.end;
    }
  }

  FileBytes cut(FileBytes bytes, std::size_t size, std::string& what) const {
    what += "cut at " + std::to_string(size) + "; ";
    bytes.resize(size);
    return bytes;
  }

  const Record& anyRecord(std::mt19937_64& random) const {
    return records_[random() % records_.size()];
  }

  static void flip(FileBytes& bytes, std::size_t byte, std::mt19937_64& random, std::string& what) {
    if (byte >= bytes.size()) return;
    const unsigned bit = random() % 8;
    bytes[byte] = static_cast<std::uint8_t>(bytes[byte] ^ 1U << bit);
    what += "bit " + std::to_string(bit) + " of byte " + std::to_string(byte) + " flipped; ";
  }

  void flipAnywhere(FileBytes& bytes, std::mt19937_64& random, std::string& what) const {
    flip(bytes, random() % bytes.size(), random, what);
  }

  void flipInHeader(FileBytes& bytes, std::mt19937_64& random, std::string& what) const {
    const Record& record = anyRecord(random);
    flip(bytes, record.begin + random() % (record.data - record.begin), random, what);
  }

  /// Replaces a length or another number by a critical value.
  void falsifyLength(FileBytes& bytes, std::mt19937_64& random, std::string& what) const {
    const Record& record = anyRecord(random);
    const std::size_t places[] = {record.begin, record.data - 4, record.begin + 4,
                                  record.begin + random() % (record.data - record.begin),
                                  record.data + random() % 64};
    const std::size_t place = places[random() % std::size(places)];
    if (place + 4 > bytes.size()) return;
    const std::uint32_t old = numberAt(place);
    const std::uint32_t values[] = {0,       1,       old + 1,     old - 1,     old * 2,
                                    old / 2, old + 4, 0x7fffffffU, 0xffffffffU, 0x40000000U};
    const std::uint32_t value = values[random() % std::size(values)];
    std::memcpy(&bytes[place], &value, 4);
    what += "number at " + std::to_string(place) + " is " + std::to_string(value) + "; ";
  }

  void cutAnywhere(FileBytes& bytes, std::mt19937_64& random, std::string& what) const {
    bytes = cut(bytes, random() % bytes.size(), what);
  }

  void swapRecords(FileBytes& bytes, std::mt19937_64& random, std::string& what) const {
    const bool chunks = random() % 2 == 0;
    std::vector<Record> those;
    for (const Record& record : records_) {
      if (!chunks || record.chunk) those.push_back(record);
    }
    Record a = those[random() % those.size()];
    Record b = those[random() % those.size()];
    if (b.begin < a.begin) std::swap(a, b);
    if (a.end > b.begin) return;  // the same record, or one within the other
    const auto at = [&](std::size_t i) { return sound_.begin() + static_cast<std::ptrdiff_t>(i); };
    bytes.assign(at(0), at(a.begin));
    bytes.insert(bytes.end(), at(b.begin), at(b.end));
    bytes.insert(bytes.end(), at(a.end), at(b.begin));
    bytes.insert(bytes.end(), at(a.begin), at(a.end));
    bytes.insert(bytes.end(), at(b.end), sound_.end());
    what +=
        "records at " + std::to_string(a.begin) + " and " + std::to_string(b.begin) + " swapped; ";
  }

  static std::pair<std::size_t, std::size_t> part(const FileBytes& bytes, std::mt19937_64& random) {
    const std::size_t begin = random() % bytes.size();
    const std::size_t size = std::size_t{1} << random() % 14;
    return {begin, std::min(size, bytes.size() - begin)};
  }

  void overwrite(FileBytes& bytes, std::mt19937_64& random, std::string& what) const {
    const auto [begin, size] = part(bytes, random);
    const bool zero = random() % 2 == 0;
    for (std::size_t i = begin; i < begin + size; ++i) {
      bytes[i] = zero ? 0 : static_cast<std::uint8_t>(random());
    }
    what += std::to_string(size) + " bytes at " + std::to_string(begin) + " overwritten; ";
  }

  void removePart(FileBytes& bytes, std::mt19937_64& random, std::string& what) const {
    const auto [begin, size] = part(bytes, random);
    const auto at = bytes.begin() + static_cast<std::ptrdiff_t>(begin);
    bytes.erase(at, at + static_cast<std::ptrdiff_t>(size));
    what += std::to_string(size) + " bytes at " + std::to_string(begin) + " removed; ";
  }

  void repeatPart(FileBytes& bytes, std::mt19937_64& random, std::string& what) const {
    const auto [begin, size] = part(bytes, random);
    const auto at = bytes.begin() + static_cast<std::ptrdiff_t>(begin);
    const FileBytes copy(at, at + static_cast<std::ptrdiff_t>(size));
    bytes.insert(bytes.begin() + static_cast<std::ptrdiff_t>(begin), copy.begin(), copy.end());
    what += std::to_string(size) + " bytes at " + std::to_string(begin) + " repeated; ";
  }

  FileBytes sound_;
  std::vector<Record> records_;
  std::vector<std::size_t> boundaries_;
};

}  // namespace ktgp_orb::test
