#pragma once

#include <ros/message_traits.h>
#include <ros/time.h>

#include <cstddef>
#include <cstdint>
#include <fstream>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <stdexcept>
#include <string>
#include <string_view>
#include <tuple>
#include <vector>

#include "bag/format.h"

namespace ktgp_orb {

/// A bag that cannot be used at all; what() gives the reason.
class UnusableBag : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

namespace bag {

/// The topic name with a leading slash and without double slashes, as `rosbag play` publishes it.
std::string topicName(const std::string& written);

/// A topic as a connection record of the bag describes it.
struct Topic {
  std::string name;  ///< see topicName()
  std::string type;
  std::string md5sum{};  ///< checksum of the type's definition; a damaged bag may lack it
  bool operator<(const Topic& other) const {
    return std::tie(name, type, md5sum) < std::tie(other.name, other.type, other.md5sum);
  }
};

/// Whether the topic's messages have the layout of `Message`. Compares the md5sums, as ROS nodes
/// do, so tf/tfMessage counts as tf2_msgs/TFMessage.
template <typename Message>
bool isOf(const Topic& topic) {
  const bool is_known = topic.md5sum.size() == 32;
  return is_known ? topic.md5sum == ros::message_traits::md5sum<Message>()
                  : topic.type == ros::message_traits::datatype<Message>();
}

/// The message times of each connection.
using Times = std::map<std::uint32_t, std::vector<ros::Time>>;

struct Chunk {
  std::size_t position;     ///< byte in the file where the record begins
  std::size_t data;         ///< byte in the file where the chunk's data begin
  std::size_t stored_size;  ///< bytes of the data as stored in the file
  std::size_t size;         ///< bytes of the uncompressed data, according to the record
  std::string compression;  ///< "none", "bz2" or "lz4"
  Times times{};            ///< times of the messages, according to the index
  bool indexed = false;
  bool index_damaged = false;
};

struct Message {
  std::uint32_t connection;
  ros::Time time;
  std::string_view data;
};

/// A chunk in memory.
struct ChunkContents {
  std::shared_ptr<char> bytes;
  /// messages in the order of the file; the data of each message point into `bytes`
  std::vector<Message> messages;
};

/// Locates all records of a bag at once, but reads the messages chunk by chunk. Notes
/// inconsistencies; after a damaged record, reading continues at the next intact record.
class BagFile {
 public:
  /// Throws UnusableBag for a file that cannot be read or is not a bag of format 2.0.
  explicit BagFile(const std::string& path);

  const std::vector<Chunk>& chunks() const { return chunks_; }
  /// All connection records; in a damaged bag they may contradict each other.
  const std::map<std::uint32_t, std::set<Topic>>& connections() const { return connections_; }
  /// For each connection, the number of messages that the index lists but the file lacks.
  const std::map<std::uint32_t, std::size_t>& missing() const { return missing_; }
  /// Whether the file ends with its index; an interrupted recording has no index.
  bool hasIndex() const { return !infos_.empty(); }
  /// Text for users about the problems found so far: describes the first few, and counts the
  /// others.
  std::string damage() const;
  /// Adds a problem unless it was noted before.
  void note(const std::string& what);

  /// All readable messages of a chunk.
  ChunkContents read(const Chunk& chunk);

 private:
  struct ChunkInfo {
    std::size_t chunk;  ///< position of the chunk in the file
    std::optional<ros::Time> start;
    std::optional<ros::Time> end;
    std::map<std::uint32_t, std::size_t> counts;
  };

  void scan();
  std::size_t scanRecord(std::size_t position);
  std::size_t skipDamage(std::size_t position);
  std::size_t addChunk(std::size_t position, const Record& record);
  void addLooseMessage(std::size_t begin, std::size_t end);
  bool addIndex(std::size_t position, const Record& record);
  void addChunkInfo(std::size_t position, const Record& record);
  void addConnection(const Record& record, std::string_view data);
  void readFileHeader(const Record& record);
  void checkAgainstHeader();
  void checkAgainstInfos();
  static bool agrees(const Chunk& chunk, const ChunkInfo& info);
  void indexFromMessages(Chunk& chunk);

  std::optional<Record> recordAt(std::size_t position);
  bool chunkMayEndAt(std::size_t position);
  std::optional<std::size_t> findInFile(std::size_t begin, const std::vector<Operation>& kinds);
  std::string bytesAt(std::size_t position, std::size_t size);
  std::string_view plainBytes(const Chunk& chunk, ChunkContents& contents);
  void noteAt(std::size_t position, const std::string& what);

  std::ifstream file_;
  std::size_t size_ = 0;
  std::vector<Chunk> chunks_;
  /// Position at which the next index record of the last chunk must begin.
  std::size_t chunk_end_ = 0;
  std::size_t damage_begin_ = 0;  ///< beginning of the damage that ends at `damage_end_`
  std::size_t damage_end_ = 0;
  std::vector<ChunkInfo> infos_;
  std::map<std::uint32_t, std::set<Topic>> connections_;
  std::map<std::uint32_t, std::size_t> missing_;
  std::optional<Record> header_;
  std::vector<std::string> noted_;  ///< texts of the first problems
  std::size_t noted_more_ = 0;
};

}  // namespace bag
}  // namespace ktgp_orb
