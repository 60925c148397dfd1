#include "bag/format.h"

#include <algorithm>
#include <cstdlib>
#include <new>

namespace ktgp_orb::bag {
namespace {

/// Bytes of a length field.
constexpr std::size_t kLength = 4;
/// Longest header that is searched after damage; nearly all are far shorter.
constexpr std::size_t kLikelyHeader = 4096;

std::optional<Operation> operationOf(const Fields& fields) {
  const std::string op = text(fields, "op");
  if (op.size() != 1 || op[0] < 2 || op[0] > 7) return std::nullopt;
  return static_cast<Operation>(op[0]);
}

/// Fast test whether a header may begin here; false for nearly all other positions.
bool mayBegin(const std::uint8_t* bytes) {
  const std::size_t header = numberAt(bytes);
  const std::size_t field = numberAt(bytes + kLength);
  return header >= 2 * kLength && header <= kLikelyHeader && field >= 2 &&
         field + kLength <= header;
}

/// Walks over the parts of a serialised message.
class Walk {
 public:
  explicit Walk(View message) : left_(message) {}
  void skip(std::size_t bytes) {
    good_ = good_ && bytes <= left_.size;
    if (good_) left_ = left_.from(bytes);
  }
  /// A string, or an array of elements of this size.
  void skipArray(std::size_t element = 1) { skip(element * count()); }
  void skipHeader() {
    skip(12);  // seq, stamp
    skipArray();
  }
  /// Of an array whose elements follow.
  std::size_t count() {
    good_ = good_ && left_.size >= kLength;
    const std::size_t count = good_ ? numberAt(left_.data) : 0;
    skip(kLength);
    return count;
  }
  bool good() const { return good_; }
  bool atEnd() const { return good_ && left_.size == 0; }

 private:
  View left_;
  bool good_ = true;
};

}  // namespace

Buffer::Buffer(std::size_t size)
    : bytes_(static_cast<std::uint8_t*>(std::calloc(std::max<std::size_t>(size, 1), 1)), std::free),
      size_(size) {
  if (!bytes_) throw std::bad_alloc();
}

std::uint32_t numberAt(const std::uint8_t* position) {
  std::uint32_t number = 0;
  for (int i = 3; i >= 0; --i) number = number << 8 | position[i];
  return number;
}

std::optional<std::uint32_t> number(const Fields& fields, const std::string& name,
                                    std::size_t offset) {
  const auto found = fields.find(name);
  if (found == fields.end() || found->second.size() < offset + 4) return std::nullopt;
  return numberAt(reinterpret_cast<const std::uint8_t*>(found->second.data()) + offset);
}

std::optional<ros::Time> time(const Fields& fields, const std::string& name) {
  const auto seconds = number(fields, name);
  const auto nanoseconds = number(fields, name, 4);
  if (!seconds || !nanoseconds || *nanoseconds >= 1000000000) return std::nullopt;
  return ros::Time(*seconds, *nanoseconds);
}

std::string text(const Fields& fields, const std::string& name) {
  const auto found = fields.find(name);
  return found == fields.end() ? "" : found->second;
}

std::optional<Fields> parseFields(View bytes) {
  Fields fields;
  while (bytes.size > 0) {
    if (bytes.size < kLength) return std::nullopt;
    const std::size_t length = numberAt(bytes.data);
    bytes = bytes.from(kLength);
    if (length > bytes.size) return std::nullopt;
    const auto* end = bytes.data + length;
    const auto* equals = std::find(bytes.data, end, '=');
    if (equals == end) return std::nullopt;
    fields[{bytes.data, equals}] = {equals + 1, end};
    bytes = bytes.from(length);
  }
  return fields;
}

std::optional<Record> parseRecord(View bytes) {
  if (bytes.size < 2 * kLength) return std::nullopt;
  const std::size_t length = numberAt(bytes.data);
  if (length > kLargestHeader || length > bytes.size - 2 * kLength) return std::nullopt;
  const auto fields = parseFields({bytes.data + kLength, length});
  const auto operation = fields ? operationOf(*fields) : std::nullopt;
  if (!operation) return std::nullopt;
  const std::size_t data = length + 2 * kLength;
  return Record{*operation, *fields, data, numberAt(bytes.data + data - kLength)};
}

std::optional<std::size_t> findRecord(View bytes, std::size_t begin,
                                      const std::vector<Operation>& kinds, std::size_t beyond) {
  for (std::size_t i = begin; i + 2 * kLength <= bytes.size; ++i) {
    if (!mayBegin(bytes.data + i)) continue;
    const auto record = parseRecord(bytes.from(i));
    if (!record || std::count(kinds.begin(), kinds.end(), record->operation) == 0) continue;
    if (record->data_size <= bytes.size - i - record->data + beyond) return i;
  }
  return std::nullopt;
}

bool isWellFormed(const std::string& type, View message) {
  constexpr std::size_t kDouble = 8;
  Walk walk(message);
  if (type == "sensor_msgs/Image") {
    walk.skipHeader();
    walk.skip(8);  // height, width
    walk.skipArray();
    walk.skip(5);  // is_bigendian, step
    walk.skipArray();
  } else if (type == "sensor_msgs/CompressedImage") {
    walk.skipHeader();
    walk.skipArray();
    walk.skipArray();
  } else if (type == "sensor_msgs/CameraInfo") {
    walk.skipHeader();
    walk.skip(8);                       // height, width
    walk.skipArray();                   // distortion_model
    walk.skipArray(kDouble);            // D
    walk.skip((9 + 9 + 12) * kDouble);  // K, R, P
    walk.skip(8 + 17);                  // binning, roi
  } else if (type == "tf2_msgs/TFMessage") {
    for (std::size_t left = walk.count(); left > 0 && walk.good(); --left) {
      walk.skipHeader();
      walk.skipArray();        // child_frame_id
      walk.skip(7 * kDouble);  // translation, rotation
    }
  } else {
    return true;
  }
  return walk.atEnd();
}

}  // namespace ktgp_orb::bag
