#pragma once

#include <ros/time.h>

#include <cstddef>
#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

/// Records of a bag of format 2.0 (http://wiki.ros.org/Bags/Format/2.0). No length in the file is
/// trusted. All bags are read by this code, since a damaged bag can crash librosbag; librosbag only
/// writes bags and decompresses chunks.
namespace ktgp_orb::bag {

/// Kind of a record, from its field "op".
enum class Operation : unsigned char {
  message = 2,
  file_header = 3,
  index = 4,  ///< times and positions of the messages of one connection in the previous chunk
  chunk = 5,
  chunk_info = 6,
  connection = 7,
};

using Fields = std::map<std::string, std::string>;

/// A record without its data.
struct Record {
  Operation operation;
  Fields fields;
  std::size_t data;       ///< bytes from the beginning of the record to its data
  std::size_t data_size;  ///< bytes of the data, according to the record; the file may have fewer
};

/// Longest plausible header of a record, in bytes; a longer header counts as damage.
constexpr std::size_t kLargestHeader = 1 << 20;

/// Reads four bytes as a little-endian number, like all numbers of the format.
std::uint32_t numberAt(const char* position);
/// The number in four bytes of a field, from byte `offset` on; empty if the field is missing or
/// short.
std::optional<std::uint32_t> number(const Fields& fields, const std::string& name,
                                    std::size_t offset = 0);
/// The time in a field of eight bytes; empty if the field is missing, short or invalid.
std::optional<ros::Time> time(const Fields& fields, const std::string& name);
/// The bytes of a field; empty if it is missing.
std::string text(const Fields& fields, const std::string& name);

/// Parses name=value pairs, each preceded by its length; empty unless they fill the bytes exactly.
std::optional<Fields> parseFields(std::string_view bytes);

/// Parses the record at the beginning of the bytes; empty unless its header is complete and well
/// formed.
std::optional<Record> parseRecord(std::string_view bytes);

/// Position of the first record at or after `begin` whose kind is in `kinds`; empty if there is
/// none. `beyond`: number of bytes that the file has after `bytes`; the record's data must end
/// within the file. Used to find the next intact record after damage.
std::optional<std::size_t> findRecord(std::string_view bytes, std::size_t begin,
                                      const std::vector<Operation>& kinds, std::size_t beyond = 0);

/// Whether the array lengths in a message of this type fit its bytes. ROS does not check this
/// before it allocates memory for an array. True for types without arrays and for types that this
/// package does not read.
bool isWellFormed(const std::string& type, std::string_view message);

}  // namespace ktgp_orb::bag
