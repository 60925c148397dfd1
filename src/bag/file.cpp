#include "bag/file.h"

#include <ros/names.h>
#include <rosbag/chunked_file.h>
#include <rosbag/exceptions.h>

#include <algorithm>
#include <cstdlib>
#include <cstring>
#include <new>

#include "files/input.h"
#include "util/format.h"

namespace ktgp_orb::bag {
namespace {

constexpr char kFirstLine[] = "#ROSBAG V2.0\n";
constexpr std::size_t kSearchBlock = 1 << 20;  // bytes read at a time when we search for a record
constexpr std::size_t kNotedAtMost = 4;        // number of problems that damage() describes
/// Largest uncompressed size that we accept for a compressed chunk, bytes. The header of a damaged
/// chunk may contain any size. rosbag writes chunks below a megabyte unless a single image is
/// larger.
constexpr std::size_t kLargestChunk = std::size_t{1} << 30;
/// Largest possible compression ratio of LZ4; a chunk that claims more is damaged.
constexpr std::size_t kLz4Ratio = 255;

const std::vector<Operation> kAnyButHeader{Operation::message, Operation::index, Operation::chunk,
                                           Operation::chunk_info, Operation::connection};
/// Record types that never occur inside a chunk.
const std::vector<Operation> kOutsideChunks{Operation::index, Operation::chunk,
                                            Operation::chunk_info};
const std::vector<Operation> kInChunks{Operation::message, Operation::connection};

/// Allocates memory that is filled with zeros. The kernel provides a page only when it is written
/// to, so it costs nothing if `size` is larger than needed. Throws std::bad_alloc.
std::shared_ptr<char> zeroedMemory(std::size_t size) {
  std::shared_ptr<char> memory(static_cast<char*>(std::calloc(std::max<std::size_t>(size, 1), 1)),
                               std::free);
  if (!memory) throw std::bad_alloc();
  return memory;
}

}  // namespace

std::string topicName(const std::string& written) {
  const std::string name = ros::names::clean(written);
  return name.empty() || name[0] == '/' ? name : "/" + name;
}

BagFile::BagFile(const std::string& path) : file_(path, std::ios::binary | std::ios::ate) {
  if (!file_) throw UnusableBag(path + " cannot be opened");
  size_ = static_cast<std::size_t>(std::max<std::streamoff>(file_.tellg(), 0));
  if (bytesAt(0, std::strlen(kFirstLine)) != kFirstLine) {
    const std::string known = files::unreadableFormat(path);
    throw UnusableBag(path + (known.empty() ? " is not a bag of format 2.0" : " " + known));
  }
  scan();
  if (header_ && !text(header_->fields, "encryptor").empty()) {
    throw UnusableBag(path + " is encrypted; decrypt it with 'rosbag decrypt'");
  }
}

void BagFile::note(const std::string& what) {
  if (std::count(noted_.begin(), noted_.end(), what) > 0) return;
  if (noted_.size() < kNotedAtMost) {
    noted_.push_back(what);
  } else {
    ++noted_more_;
  }
}

std::string BagFile::damage() const {
  const std::string text = util::joined(noted_, "; ");
  return noted_more_ > 0 ? text + "; and " + std::to_string(noted_more_) + " more" : text;
}

void BagFile::noteAt(std::size_t position, const std::string& what) {
  note(what + " at byte " + std::to_string(position));
}

/// Reads `size` bytes from `position` on, or fewer at the end of the file.
std::string BagFile::bytesAt(std::size_t position, std::size_t size) {
  std::string bytes(position < size_ ? std::min(size, size_ - position) : 0, '\0');
  file_.clear();
  file_.seekg(static_cast<std::streamoff>(position));
  file_.read(bytes.data(), static_cast<std::streamsize>(bytes.size()));
  bytes.resize(static_cast<std::size_t>(std::max<std::streamsize>(file_.gcount(), 0)));
  return bytes;
}

std::optional<Record> BagFile::recordAt(std::size_t position) {
  constexpr std::size_t kUsual = 512;
  auto bytes = bytesAt(position, kUsual);
  if (bytes.size() == kUsual && numberAt(bytes.data()) > kUsual - 8) {
    const std::size_t header = numberAt(bytes.data());
    if (header > kLargestHeader) return std::nullopt;
    bytes = bytesAt(position, header + 8);
  }
  return parseRecord(bytes);
}

std::optional<std::size_t> BagFile::findInFile(std::size_t begin,
                                               const std::vector<Operation>& kinds) {
  constexpr std::size_t kOverlap = 8192;  // bytes; longer than any header that findRecord() accepts
  for (std::size_t block = begin; block < size_; block += kSearchBlock) {
    const auto bytes = bytesAt(block, kSearchBlock + kOverlap);
    const std::size_t beyond = size_ - block - bytes.size();
    const auto found = findRecord(bytes, 0, kinds, beyond);
    if (found) return block + *found;
  }
  return std::nullopt;
}

// These functions find the records of the file.

void BagFile::scan() {
  std::size_t position = std::strlen(kFirstLine);
  while (position < size_) position = scanRecord(position);
  for (Chunk& chunk : chunks_) {
    const bool known = std::all_of(chunk.times.begin(), chunk.times.end(), [this](const auto& of) {
      return connections_.count(of.first) > 0;
    });
    if (!chunk.indexed || chunk.index_damaged || !known) indexFromMessages(chunk);
  }
  checkAgainstHeader();
  checkAgainstInfos();
}

/// Reads the record at `position` and returns the position of the next record.
std::size_t BagFile::scanRecord(std::size_t position) {
  const auto record = recordAt(position);
  if (!record) return skipDamage(position);
  if (record->operation == Operation::chunk) return addChunk(position, *record);
  const std::size_t data = position + record->data;
  if (record->data_size > size_ - data) return skipDamage(position);
  const std::size_t end = data + record->data_size;
  switch (record->operation) {
    case Operation::file_header:
      readFileHeader(*record);
      if (!chunkMayEndAt(end)) return skipDamage(position);
      break;
    case Operation::index:
      if (!addIndex(position, *record)) return skipDamage(position);
      break;
    case Operation::chunk_info:
      addChunkInfo(position, *record);
      break;
    case Operation::connection:
      addConnection(*record, bytesAt(data, record->data_size));
      break;
    case Operation::message:
      addLooseMessage(position, end);
      break;
    case Operation::chunk:
      break;
  }
  return end;
}

std::size_t BagFile::skipDamage(std::size_t position) {
  noteAt(position, "damaged or cut off");
  damage_begin_ = position;
  damage_end_ = findInFile(position + 1, kAnyButHeader).value_or(size_);
  const auto next = recordAt(damage_end_);
  const bool index_follows = next && next->operation == Operation::index;
  if (chunk_end_ == position && !chunks_.empty()) {
    chunks_.back().index_damaged = true;
  } else if (index_follows) {  // a chunk is lost, but its index still lists its messages
    chunks_.push_back({position, position, 0, 0, "none"});
  }
  if (index_follows) chunk_end_ = damage_end_;
  return damage_end_;
}

bool BagFile::chunkMayEndAt(std::size_t position) {
  if (position >= size_) return position == size_;
  const auto next = recordAt(position);
  return next && next->operation != Operation::message && next->operation != Operation::file_header;
}

std::size_t BagFile::addChunk(std::size_t position, const Record& record) {
  Chunk chunk{position, position + record.data, record.data_size,
              number(record.fields, "size").value_or(0), text(record.fields, "compression")};
  if (!chunkMayEndAt(chunk.data + chunk.stored_size)) {
    if (chunk.compression == "none" && chunkMayEndAt(chunk.data + chunk.size)) {
      noteAt(position, "a wrong size");
      chunk.stored_size = chunk.size;
    } else {
      // Either the size of the chunk is wrong, or the next record is damaged. To decide, look for
      // the next intact record that cannot be inside a chunk.
      const std::size_t found = findInFile(chunk.data, kOutsideChunks).value_or(size_) - chunk.data;
      if (found < chunk.stored_size) {
        noteAt(position, "damaged or cut off");
        chunk.stored_size = found;
      }
    }
  }
  chunks_.push_back(chunk);
  return chunk_end_ = chunk.data + chunk.stored_size;
}

/// Adds a message that is not in a chunk, or whose chunk has lost its beginning.
void BagFile::addLooseMessage(std::size_t begin, std::size_t end) {
  const bool goes_on = !chunks_.empty() && chunk_end_ == begin && !chunks_.back().indexed;
  if (goes_on) {
    chunks_.back().stored_size = chunks_.back().size = end - chunks_.back().data;
  } else {
    const std::size_t position = damage_end_ == begin ? damage_begin_ : begin;
    chunks_.push_back({position, begin, end - begin, end - begin, "none"});
  }
  chunk_end_ = end;
}

/// Adds the index record to the last chunk. Returns false if it is not a valid index of that chunk.
bool BagFile::addIndex(std::size_t position, const Record& record) {
  constexpr std::size_t kEntry = 12;  // bytes of an entry: message time, position in the chunk
  const auto connection = number(record.fields, "conn");
  const auto count = number(record.fields, "count");
  const bool fits = count && record.data_size == kEntry * std::size_t{*count};
  if (!connection || !fits || chunk_end_ != position || chunks_.empty()) return false;
  Chunk& chunk = chunks_.back();
  std::vector<ros::Time>& times = chunk.times[*connection];
  const auto bytes = bytesAt(position + record.data, record.data_size);
  for (std::size_t i = 0; i + kEntry <= bytes.size(); i += kEntry) {
    const std::uint32_t nanoseconds = numberAt(bytes.data() + i + 4);
    times.emplace_back(numberAt(bytes.data() + i), std::min(nanoseconds, 999999999U));
  }
  chunk.indexed = true;
  chunk_end_ = position + record.data + record.data_size;
  return true;
}

void BagFile::addChunkInfo(std::size_t position, const Record& record) {
  constexpr std::size_t kEntry = 8;  // bytes of an entry: connection, number of messages
  const auto low = number(record.fields, "chunk_pos");
  const auto high = number(record.fields, "chunk_pos", 4);
  const auto bytes = bytesAt(position + record.data, record.data_size);
  if (!low || !high || bytes.size() % kEntry != 0) {
    noteAt(position, "a damaged index");
    return;
  }
  ChunkInfo info{std::size_t{*high} << 32 | *low,
                 time(record.fields, "start_time"),
                 time(record.fields, "end_time"),
                 {}};
  for (std::size_t i = 0; i < bytes.size(); i += kEntry) {
    info.counts[numberAt(bytes.data() + i)] = numberAt(bytes.data() + i + 4);
  }
  infos_.push_back(info);
}

void BagFile::addConnection(const Record& record, std::string_view data) {
  const auto connection = number(record.fields, "conn");
  const auto fields = parseFields(data);
  if (!connection || !fields) {
    note("a damaged connection");
    return;
  }
  auto& topics = connections_[*connection];
  topics.insert(
      {topicName(text(record.fields, "topic")), text(*fields, "type"), text(*fields, "md5sum")});
  if (topics.size() == 2) {
    note("connection " + std::to_string(*connection) + " has two different descriptions");
  }
}

void BagFile::readFileHeader(const Record& record) {
  header_ = record;
  const auto low = number(record.fields, "index_pos");
  const auto high = number(record.fields, "index_pos", 4);
  if (low && high && *low == 0 && *high == 0) note("no index; was the recording interrupted?");
}

void BagFile::checkAgainstHeader() {
  if (!header_) {
    note("the header of the bag is damaged");
    return;
  }
  const auto low = number(header_->fields, "index_pos");
  if (low && *low == 0) return;  // an interrupted recording has no counts yet
  const auto is = [this](const char* name, std::size_t found) {
    const auto count = number(header_->fields, name);
    if (count && *count == found) return;
    note(std::string("the header of the bag has ") + name + " " +
         (count ? std::to_string(*count) : "missing") + ", the file " + std::to_string(found));
  };
  is("chunk_count", chunks_.size());
  is("conn_count", connections_.size());
}

/// Compares each chunk with its entry in the index at the end of the file, and counts the messages
/// that are missing.
void BagFile::checkAgainstInfos() {
  constexpr std::size_t kLeastMessage = 32;  // bytes of the smallest message record
  std::map<std::size_t, Chunk*> at;
  for (Chunk& chunk : chunks_) at[chunk.position] = &chunk;
  for (const ChunkInfo& info : infos_) {
    const auto found = at.find(info.chunk);
    if (found == at.end()) {
      note("there is no chunk at byte " + std::to_string(info.chunk));
    } else if (!agrees(*found->second, info)) {
      noteAt(info.chunk, "the index and the messages differ in the chunk");
      indexFromMessages(*found->second);
    }
    for (const auto& of : info.counts) {
      const bool known = found != at.end() && found->second->times.count(of.first) > 0;
      missing_[of.first] += known ? found->second->times[of.first].size()
                                  : std::min(of.second, size_ / kLeastMessage);
    }
  }
  // missing_ now counts the messages of all chunks that the index lists. Subtract the messages that
  // the file has, wherever their chunks lie.
  for (auto& of : missing_) {
    std::size_t there = 0;
    for (const Chunk& chunk : chunks_) {
      const auto times = chunk.times.find(of.first);
      if (times != chunk.times.end()) there += times->second.size();
    }
    of.second -= std::min(of.second, there);
  }
}

bool BagFile::agrees(const Chunk& chunk, const ChunkInfo& info) {
  if (info.counts.size() != chunk.times.size()) return false;
  ros::Time first = ros::TIME_MAX;
  ros::Time last = ros::TIME_MIN;
  for (const auto& of : chunk.times) {
    const auto count = info.counts.find(of.first);
    if (count == info.counts.end() || count->second != of.second.size()) return false;
    for (const ros::Time& time : of.second) {
      first = std::min(first, time);
      last = std::max(last, time);
    }
  }
  return chunk.times.empty() || (info.start == first && info.end == last);
}

/// Reads the messages of a chunk to replace its missing or wrong index.
void BagFile::indexFromMessages(Chunk& chunk) {
  Times times;
  const ChunkContents contents = read(chunk);
  for (const Message& message : contents.messages) {
    times[message.connection].push_back(message.time);
  }
  // If the old index lists more messages of a connection than the chunk contains, keep the old
  // times: the difference then counts as missing messages.
  for (const auto& of : chunk.times) {
    const bool is_connection = connections_.count(of.first) > 0;
    if (is_connection && of.second.size() > times[of.first].size()) times[of.first] = of.second;
  }
  chunk.times = std::move(times);
  chunk.index_damaged = false;
  chunk.indexed = true;
}

// These functions read the messages of a chunk.

/// Decompresses a chunk into the memory of `contents`. Throws rosbag::BagException or
/// std::bad_alloc.
std::string_view BagFile::plainBytes(const Chunk& chunk, ChunkContents& contents) {
  std::string stored = bytesAt(chunk.data, chunk.stored_size);
  if (chunk.compression == "none") {
    contents.bytes = zeroedMemory(stored.size());
    stored.copy(contents.bytes.get(), stored.size());
    return {contents.bytes.get(), stored.size()};
  }
  const bool lz4 = chunk.compression == "lz4";
  if (!lz4 && chunk.compression != "bz2") {
    throw rosbag::BagException("compression '" + chunk.compression + "' is unknown");
  }
  if (chunk.size > kLargestChunk || (lz4 && chunk.size / kLz4Ratio > stored.size())) {
    throw rosbag::BagException(std::to_string(stored.size()) + " bytes claim to be " +
                               std::to_string(chunk.size));
  }
  contents.bytes = zeroedMemory(chunk.size);
  const auto type = lz4 ? rosbag::compression::LZ4 : rosbag::compression::BZ2;
  rosbag::ChunkedFile().decompress(type, reinterpret_cast<std::uint8_t*>(contents.bytes.get()),
                                   static_cast<unsigned int>(chunk.size),
                                   reinterpret_cast<std::uint8_t*>(stored.data()),
                                   static_cast<unsigned int>(stored.size()));
  return {contents.bytes.get(), chunk.size};
}

ChunkContents BagFile::read(const Chunk& chunk) {
  ChunkContents contents;
  std::string_view bytes;
  try {
    bytes = plainBytes(chunk, contents);
  } catch (const std::exception& error) {  // the chunk is damaged or too large for the memory
    noteAt(chunk.position, std::string("a chunk cannot be decompressed (") + error.what() + ")");
    return contents;
  }
  std::size_t position = 0;
  while (position < bytes.size()) {
    const auto record = parseRecord(bytes.substr(position));
    const bool here = record && record->data_size <= bytes.size() - position - record->data;
    if (!here) {
      noteAt(chunk.position, "a part is damaged or cut off in the chunk");
      position = findRecord(bytes, position + 1, kInChunks).value_or(bytes.size());
      continue;
    }
    const std::string_view data = bytes.substr(position + record->data, record->data_size);
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
  return contents;
}

}  // namespace ktgp_orb::bag
