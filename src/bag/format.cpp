#include "bag/format.h"

#include <algorithm>
#include <cstdlib>

namespace ktgp_orb::bag {
namespace {

/// Size of a length field, bytes.
constexpr std::size_t kLength = 4;
/// Largest header, bytes, that we accept when we search for a record after damage. Nearly all
/// headers are far shorter.
constexpr std::size_t kLikelyHeader = 4096;

std::optional<Operation> operationOf(const Fields& fields) {
  const std::string op = text(fields, "op");
  if (op.size() != 1 || op[0] < 2 || op[0] > 7) return std::nullopt;
  return static_cast<Operation>(op[0]);
}

/// Fast test that rejects nearly all positions where no record begins. Returns true if a record may
/// begin at `bytes`.
bool mayBegin(const char* bytes) {
  const std::size_t header = numberAt(bytes);
  const std::size_t field = numberAt(bytes + kLength);
  return header >= 2 * kLength && header <= kLikelyHeader && field >= 2 &&
         field + kLength <= header;
}

/// Reads the number of elements at the beginning of a serialised array, and removes this number
/// from `message`; empty if the message is too short.
std::optional<std::size_t> takeCount(std::string_view& message) {
  if (message.size() < kLength) return std::nullopt;
  const std::size_t count = numberAt(message.data());
  message.remove_prefix(kLength);
  return count;
}

/// Removes several fields from the beginning of a serialised message. `parts`: for each field, its
/// size in bytes, or -n for an array (or a text) whose elements have n bytes. Returns false if the
/// message is too short.
bool take(const std::vector<int>& parts, std::string_view& message) {
  for (const int part : parts) {
    auto size = static_cast<std::size_t>(std::abs(part));
    if (part < 0) {
      const auto count = takeCount(message);
      if (!count) return false;
      size *= *count;
    }
    if (size > message.size()) return false;
    message.remove_prefix(size);
  }
  return true;
}

}  // namespace

std::uint32_t numberAt(const char* position) {
  std::uint32_t number = 0;
  for (int i = 3; i >= 0; --i) number = number << 8 | static_cast<unsigned char>(position[i]);
  return number;
}

std::optional<std::uint32_t> number(const Fields& fields, const std::string& name,
                                    std::size_t offset) {
  const auto found = fields.find(name);
  if (found == fields.end() || found->second.size() < offset + 4) return std::nullopt;
  return numberAt(found->second.data() + offset);
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

std::optional<Fields> parseFields(std::string_view bytes) {
  Fields fields;
  while (!bytes.empty()) {
    if (bytes.size() < kLength) return std::nullopt;
    const std::size_t length = numberAt(bytes.data());
    bytes.remove_prefix(kLength);
    if (length > bytes.size()) return std::nullopt;
    const std::string_view field = bytes.substr(0, length);
    const std::size_t equals = field.find('=');
    if (equals == std::string_view::npos) return std::nullopt;
    fields[std::string(field.substr(0, equals))] = field.substr(equals + 1);
    bytes.remove_prefix(length);
  }
  return fields;
}

std::optional<Record> parseRecord(std::string_view bytes) {
  if (bytes.size() < 2 * kLength) return std::nullopt;
  const std::size_t length = numberAt(bytes.data());
  if (length > kLargestHeader || length > bytes.size() - 2 * kLength) return std::nullopt;
  const auto fields = parseFields(bytes.substr(kLength, length));
  const auto operation = fields ? operationOf(*fields) : std::nullopt;
  if (!operation) return std::nullopt;
  const std::size_t data = length + 2 * kLength;
  return Record{*operation, *fields, data, numberAt(bytes.data() + data - kLength)};
}

std::optional<std::size_t> findRecord(std::string_view bytes, std::size_t begin,
                                      const std::vector<Operation>& kinds, std::size_t beyond) {
  for (std::size_t i = begin; i + 2 * kLength <= bytes.size(); ++i) {
    if (!mayBegin(bytes.data() + i)) continue;
    const auto record = parseRecord(bytes.substr(i));
    if (!record || std::count(kinds.begin(), kinds.end(), record->operation) == 0) continue;
    if (record->data_size <= bytes.size() - i - record->data + beyond) return i;
  }
  return std::nullopt;
}

bool isWellFormed(const std::string& type, std::string_view message) {
  constexpr int kStamp = 12;  // bytes of seq and stamp; frame_id follows
  constexpr int kText = -1;
  constexpr int kDouble = 8;
  if (type == "sensor_msgs/Image") {
    // After the header: height and width, encoding, is_bigendian and step, data.
    return take({kStamp, kText, 8, kText, 5, -1}, message) && message.empty();
  }
  if (type == "sensor_msgs/CompressedImage") {  // format, data
    return take({kStamp, kText, kText, -1}, message) && message.empty();
  }
  if (type == "sensor_msgs/CameraInfo") {
    // After the header: height and width, distortion_model, D, K and R and P, binning, roi.
    const int matrices = (9 + 9 + 12) * kDouble;
    return take({kStamp, kText, 8, kText, -kDouble, matrices, 8, 17}, message) && message.empty();
  }
  if (type != "tf2_msgs/TFMessage") return true;
  const auto count = takeCount(message);
  // A transform: header, child_frame_id, translation and rotation.
  const std::vector<int> transform{kStamp, kText, kText, 7 * kDouble};
  for (std::size_t left = count.value_or(0); left > 0; --left) {
    if (!take(transform, message)) return false;
  }
  return count && message.empty();
}

}  // namespace ktgp_orb::bag
