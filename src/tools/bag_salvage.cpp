#include "tools/bag_salvage.h"

#include <rosbag/chunked_file.h>
#include <rosbag/constants.h>
#include <rosbag/exceptions.h>

#include <algorithm>
#include <cstring>

#include "tools/bag_reader.h"

namespace ktgp_orb {
namespace {

using Bytes = std::vector<std::uint8_t>;
using Fields = std::map<std::string, std::string>;

constexpr char kFirstLine[] = "#ROSBAG V2.0\n";
constexpr std::size_t kLargestHeader = 1 << 20;  // bytes; a longer one is damage, not a header

/// A little-endian number at `position`, as all numbers of the format are.
std::uint32_t numberAt(const std::uint8_t* position) {
  std::uint32_t number = 0;
  for (int i = 3; i >= 0; --i) number = number << 8 | position[i];
  return number;
}

/// A number in a record header; 0 where the field is missing or short.
std::uint32_t number(const Fields& fields, const std::string& name, std::size_t offset = 0) {
  const auto found = fields.find(name);
  if (found == fields.end() || found->second.size() < offset + 4) return 0;
  return numberAt(reinterpret_cast<const std::uint8_t*>(found->second.data()) + offset);
}

std::string text(const Fields& fields, const std::string& name) {
  const auto found = fields.find(name);
  return found == fields.end() ? "" : found->second;
}

unsigned char operation(const Fields& fields) {
  const std::string op = text(fields, "op");
  return op.size() == 1 ? static_cast<unsigned char>(op[0]) : 0;
}

/// name=value pairs, each after its length.
Fields parseFields(const std::uint8_t* bytes, std::size_t size) {
  Fields fields;
  std::size_t position = 0;
  while (position + 4 <= size) {
    const std::size_t length = numberAt(bytes + position);
    position += 4;
    if (length > size - position) break;
    const auto* begin = bytes + position;
    const auto* equals = std::find(begin, begin + length, '=');
    if (equals != begin + length) fields[{begin, equals}] = {equals + 1, begin + length};
    position += length;
  }
  return fields;
}

}  // namespace

bool isImageType(const std::string& type) {
  return type == "sensor_msgs/Image" || type == "sensor_msgs/CompressedImage";
}

BagRecords::BagRecords(const std::string& path) : file_(path, std::ios::binary | std::ios::ate) {
  if (!file_) throw UnusableBag(path + " cannot be opened");
  file_size_ = static_cast<std::size_t>(file_.tellg());
  file_.seekg(0);
  std::string line(std::strlen(kFirstLine), ' ');
  file_.read(&line[0], static_cast<std::streamsize>(line.size()));
  if (line != kFirstLine) throw UnusableBag(path + " is no bag of format 2.0");
}

void BagRecords::setDamage(const std::string& what) {
  if (damage_.empty()) damage_ = what;
}

std::optional<SalvagedMessage> BagRecords::next() {
  while (true) {
    std::optional<Record> record = nextInChunk();
    if (!record) record = readRecord();
    if (!record) return std::nullopt;
    const unsigned char op = operation(record->fields);
    if (op == rosbag::OP_CHUNK) openChunk(*record);
    if (op == rosbag::OP_CONNECTION) addConnection(*record);
    if (op == rosbag::OP_MSG_DATA && record->complete) {
      if (auto message = messageFrom(*record)) return message;
    }
  }
}

/// `size` bytes of the file, fewer at its end.
std::optional<BagRecords::Bytes> BagRecords::read(std::size_t size) {
  const auto position = file_.tellg();
  if (position < 0) return std::nullopt;
  Bytes bytes(std::min(size, file_size_ - static_cast<std::size_t>(position)));
  file_.read(reinterpret_cast<char*>(bytes.data()), static_cast<std::streamsize>(bytes.size()));
  if (!file_) return std::nullopt;
  return bytes;
}

std::optional<BagRecords::Record> BagRecords::readRecord() {
  const std::string where = "damaged or cut off at byte " + std::to_string(file_.tellg());
  if (!damage_.empty() || static_cast<std::size_t>(file_.tellg()) == file_size_) {
    return std::nullopt;
  }
  const auto header_length = read(4);
  if (!header_length || header_length->size() < 4 ||
      numberAt(header_length->data()) > kLargestHeader) {
    setDamage(where);
    return std::nullopt;
  }
  const std::size_t length = numberAt(header_length->data());
  const auto header = read(length);
  const auto data_length = read(4);
  if (!header || header->size() < length || !data_length || data_length->size() < 4) {
    setDamage(where);
    return std::nullopt;
  }
  Record record;
  record.fields = parseFields(header->data(), header->size());
  const std::size_t data_size = numberAt(data_length->data());
  record.data = read(data_size).value_or(Bytes());
  record.complete = record.data.size() == data_size;
  if (!record.complete) setDamage(where);
  return record;
}

void BagRecords::openChunk(Record& chunk) {
  const std::string compression = text(chunk.fields, "compression");
  chunk_position_ = 0;
  chunk_ = {};
  if (compression == "none") {
    chunk_ = std::move(chunk.data);  // of an incomplete one the beginning is as good as ever
    return;
  }
  if (!chunk.complete) return;
  Bytes plain(number(chunk.fields, "size"));
  try {
    const auto type = compression == "lz4" ? rosbag::compression::LZ4 : rosbag::compression::BZ2;
    rosbag::ChunkedFile().decompress(type, plain.data(), static_cast<unsigned int>(plain.size()),
                                     chunk.data.data(),
                                     static_cast<unsigned int>(chunk.data.size()));
    chunk_ = std::move(plain);
  } catch (const rosbag::BagException& error) {
    setDamage(std::string("a compressed part is damaged: ") + error.what());
  }
}

std::optional<BagRecords::Record> BagRecords::nextInChunk() {
  const auto left = [this] { return chunk_.size() - chunk_position_; };
  if (left() < 4) return std::nullopt;
  const std::size_t header_size = numberAt(chunk_.data() + chunk_position_);
  if (header_size > kLargestHeader || left() < 8 + header_size) {
    chunk_position_ = chunk_.size();
    return std::nullopt;
  }
  Record record;
  record.fields = parseFields(chunk_.data() + chunk_position_ + 4, header_size);
  chunk_position_ += 4 + header_size;
  const std::size_t data_size = numberAt(chunk_.data() + chunk_position_);
  chunk_position_ += 4;
  record.complete = data_size <= left();
  const std::size_t size = std::min(data_size, left());
  const auto begin = chunk_.begin() + static_cast<std::ptrdiff_t>(chunk_position_);
  record.data.assign(begin, begin + static_cast<std::ptrdiff_t>(size));
  chunk_position_ += size;
  return record;
}

void BagRecords::addConnection(const Record& record) {
  const Fields fields = parseFields(record.data.data(), record.data.size());
  connections_[number(record.fields, "conn")] = {text(record.fields, "topic"),
                                                 text(fields, "type")};
}

std::optional<SalvagedMessage> BagRecords::messageFrom(Record& record) const {
  const auto connection = connections_.find(number(record.fields, "conn"));
  if (connection == connections_.end()) return std::nullopt;
  const ros::Time time(number(record.fields, "time"), number(record.fields, "time", 4));
  return SalvagedMessage{connection->second.topic, connection->second.type, time,
                         std::move(record.data)};
}

}  // namespace ktgp_orb
