// Reads the messages of a chunk.
#include <rosbag/chunked_file.h>
#include <rosbag/exceptions.h>

#include <cstring>

#include "bag/file.h"

namespace ktgp_orb::bag {
namespace {

/// A damaged compressed chunk may declare any size; rosbag's own are below a megabyte, or one
/// image.
constexpr std::size_t kLargestChunk = std::size_t{1} << 30;
/// Largest compression ratio of LZ4.
constexpr std::size_t kLz4Ratio = 255;

const std::vector<Operation> kInChunks{Operation::message, Operation::connection};

}  // namespace

/// Throws rosbag::BagException or std::bad_alloc.
Buffer BagFile::plainBytes(const Chunk& chunk) {
  auto stored = bytesAt(chunk.data, chunk.stored_size);
  if (chunk.compression == "none") {
    Buffer plain(stored.size());
    if (!stored.empty()) std::memcpy(plain.data(), stored.data(), stored.size());
    return plain;
  }
  const bool lz4 = chunk.compression == "lz4";
  if (!lz4 && chunk.compression != "bz2") {
    throw rosbag::BagException("compression '" + chunk.compression + "' is unknown");
  }
  if (chunk.size > kLargestChunk || (lz4 && chunk.size / kLz4Ratio > stored.size())) {
    throw rosbag::BagException(std::to_string(stored.size()) + " bytes claim to be " +
                               std::to_string(chunk.size));
  }
  Buffer plain(chunk.size);
  const auto type = lz4 ? rosbag::compression::LZ4 : rosbag::compression::BZ2;
  rosbag::ChunkedFile().decompress(type, plain.data(), static_cast<unsigned int>(chunk.size),
                                   stored.data(), static_cast<unsigned int>(stored.size()));
  return plain;
}

ChunkContents BagFile::read(const Chunk& chunk) {
  ChunkContents contents;
  try {
    contents.bytes = plainBytes(chunk);
  } catch (const std::exception& error) {  // of rosbag, or no memory
    noteAt(chunk.position, std::string("a chunk cannot be decompressed (") + error.what() + ")");
    return contents;
  }
  readMessages(chunk, contents);
  return contents;
}

void BagFile::readMessages(const Chunk& chunk, ChunkContents& contents) {
  const View bytes = contents.bytes.view();
  std::size_t position = 0;
  while (position < bytes.size) {
    const auto record = parseRecord(bytes.from(position));
    const bool here = record && record->data_size <= bytes.size - position - record->data;
    if (!here) {
      noteAt(chunk.position, "a part is damaged or cut off in the chunk");
      position = findRecord(bytes, position + 1, kInChunks).value_or(bytes.size);
      continue;
    }
    const View data{bytes.data + position + record->data, record->data_size};
    position += record->data + record->data_size;
    if (record->operation == Operation::connection) addConnection(*record, data);
    if (record->operation != Operation::message) continue;
    const auto connection = number(record->fields, "conn");
    const auto when = time(record->fields, "time");
    if (connection && when) {
      contents.messages.push_back({*connection, *when, data});
    } else {
      noteAt(chunk.position, "a damaged message in the chunk");
    }
  }
}

}  // namespace ktgp_orb::bag
