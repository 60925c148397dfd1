#pragma once

#include <ros/time.h>

#include <cstddef>
#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

/// Records of a bag of format 2.0 (http://wiki.ros.org/Bags/Format/2.0). This code trusts no length
/// in the file. We read all bags with this code, because a damaged bag can crash librosbag; we use
/// librosbag only to write bags and to decompress chunks.
namespace ktgp_orb::bag {

/// Type of a record: the value of its field "op".
enum class Operation : unsigned char {
  message = 2,
  file_header = 3,
  index = 4,  ///< times and positions of one connection's messages in the preceding chunk
  chunk = 5,
  chunk_info = 6,
  connection = 7,
};

using Fields = std::map<std::string, std::string>;

/// The header of a record, and where its data are.
struct Record {
  Operation operation;
  Fields fields;
  std::size_t data;       ///< position of the data, bytes from the record's beginning
  std::size_t data_size;  ///< size of the data, bytes; the file may be shorter
};

/// Largest size of a header, bytes. A record with a longer header counts as damaged.
constexpr std::size_t kLargestHeader = 1 << 20;

/// Reads four bytes as a little-endian number; all numbers of the format are stored like this.
std::uint32_t numberAt(const char* position);
/// The four-byte number that begins at byte `offset` of a field; empty if the field is missing or
/// too short.
std::optional<std::uint32_t> number(const Fields& fields, const std::string& name,
                                    std::size_t offset = 0);
/// The time in a field of eight bytes; empty if the field is missing, too short or invalid.
std::optional<ros::Time> time(const Fields& fields, const std::string& name);
/// The bytes of a field; an empty string if the field is missing.
std::string text(const Fields& fields, const std::string& name);

/// Parses the fields of a record: name=value pairs, each with its length before it. Returns nothing
/// unless the pairs fill the bytes exactly.
std::optional<Fields> parseFields(std::string_view bytes);

/// Parses the record at the beginning of the bytes. Returns nothing unless its header is complete
/// and well formed.
std::optional<Record> parseRecord(std::string_view bytes);

/// Finds the next intact record after damage: returns the position of the first record at or after
/// `begin` whose type is in `kinds`; empty if there is none. The record's data must end within the
/// file. `beyond`: number of bytes that the file has after `bytes`.
std::optional<std::size_t> findRecord(std::string_view bytes, std::size_t begin,
                                      const std::vector<Operation>& kinds, std::size_t beyond = 0);

/// Returns true if the lengths of the arrays in a message of this type fit its size. ROS does not
/// check this before it allocates memory for an array. Also returns true for types that have no
/// arrays or that this package does not read.
bool isWellFormed(const std::string& type, std::string_view message);

}  // namespace ktgp_orb::bag
