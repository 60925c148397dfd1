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
/// trusted. All bags are read by this code, since a damaged bag can crash librosbag; librosbag is
/// used only for writing.
namespace ktgp_orb::bag {

/// The kind of a record: its field "op".
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

/// Longest header of a record, bytes; a longer one is damage.
constexpr std::size_t kLargestHeader = 1 << 20;

/// Little-endian, like all numbers of the format; `position` has four bytes.
std::uint32_t numberAt(const char* position);
/// A field of four bytes (from `offset` on); empty if it is missing or short.
std::optional<std::uint32_t> number(const Fields& fields, const std::string& name,
                                    std::size_t offset = 0);
/// A field of eight bytes with a time.
std::optional<ros::Time> time(const Fields& fields, const std::string& name);
/// Empty if the field is missing.
std::string text(const Fields& fields, const std::string& name);

/// name=value pairs, each after its length; empty unless they fill the bytes exactly.
std::optional<Fields> parseFields(std::string_view bytes);

/// The record at the beginning of the bytes; empty unless its whole header is there and well
/// formed.
std::optional<Record> parseRecord(std::string_view bytes);

/// The first position from `begin` on of a record of one of the kinds, with all its data within the
/// bytes and `beyond` more; empty if there is none. This is how reading continues after damage.
std::optional<std::size_t> findRecord(std::string_view bytes, std::size_t begin,
                                      const std::vector<Operation>& kinds, std::size_t beyond = 0);

/// Whether a message of this type can be deserialised: its lengths fit its bytes. ROS does not
/// check this before it allocates the memory of an array. True for types that have no arrays or are
/// not read here.
bool isWellFormed(const std::string& type, std::string_view message);

}  // namespace ktgp_orb::bag
