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

/// A topic with its message type, as a connection record of the bag describes it.
struct Topic {
  std::string name;  ///< see topicName()
  std::string type;
  std::string md5sum{};  ///< checksum of the message definition; empty if damaged
  bool operator<(const Topic& other) const {
    return std::tie(name, type, md5sum) < std::tie(other.name, other.type, other.md5sum);
  }
};

/// Returns true if the topic's messages have the layout of `Message`. Compares the md5sums, as ROS
/// nodes do, so that tf/tfMessage is accepted as tf2_msgs/TFMessage.
template <typename Message>
bool isOf(const Topic& topic) {
  const bool is_known = topic.md5sum.size() == 32;
  return is_known ? topic.md5sum == ros::message_traits::md5sum<Message>()
                  : topic.type == ros::message_traits::datatype<Message>();
}

/// The times of the messages of each connection. The key is the id of the connection.
using Times = std::map<std::uint32_t, std::vector<ros::Time>>;

struct Chunk {
  std::size_t position;     ///< position of the chunk's record in the file, bytes
  std::size_t data;         ///< position of the chunk's data in the file, bytes
  std::size_t stored_size;  ///< size of the data in the file (compressed), bytes
  std::size_t size;         ///< size of the uncompressed data according to the record, bytes
  std::string compression;  ///< "none", "bz2" or "lz4"
  /// message times from the index; from the messages if the index is missing or wrong
  Times times{};
  bool indexed = false;
  bool index_damaged = false;
};

struct Message {
  std::uint32_t connection;
  ros::Time time;
  std::string_view data;
};

/// The uncompressed data of a chunk.
struct ChunkContents {
  std::shared_ptr<char> bytes;
  /// messages in the order of the file; the data of each message point into `bytes`
  std::vector<Message> messages;
};

/// A bag file. The constructor finds all records; read() reads the messages chunk by chunk. If a
/// record is damaged, goes on with the next intact record. damage() describes the problems.
class BagFile {
 public:
  /// Throws UnusableBag if the file cannot be read or is not a bag of format 2.0.
  explicit BagFile(const std::string& path);

  const std::vector<Chunk>& chunks() const { return chunks_; }
  /// The topics of each connection id. In a damaged bag, connection records may contradict each
  /// other, so that an id has several topics.
  const std::map<std::uint32_t, std::set<Topic>>& connections() const { return connections_; }
  /// For each connection, the number of messages that the index lists but the file lacks.
  const std::map<std::uint32_t, std::size_t>& missing() const { return missing_; }
  /// Returns true if the file ends with an index. An interrupted recording has none.
  bool hasIndex() const { return !infos_.empty(); }
  /// Text for users about the problems found so far: describes the first few and says how many more
  /// there are.
  std::string damage() const;
  /// Adds a problem to damage(), unless the same text was added before.
  void note(const std::string& what);

  /// Reads all intact messages of a chunk.
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
  /// Position where the last chunk ends, including its index records that were read so far. Its
  /// next index record must begin here.
  std::size_t chunk_end_ = 0;
  std::size_t damage_begin_ = 0;  ///< position where the last damaged part begins
  std::size_t damage_end_ = 0;
  std::vector<ChunkInfo> infos_;
  std::map<std::uint32_t, std::set<Topic>> connections_;
  std::map<std::uint32_t, std::size_t> missing_;
  std::optional<Record> header_;
  std::vector<std::string> noted_;  ///< texts of the first few problems
  std::size_t noted_more_ = 0;
};

}  // namespace bag
}  // namespace ktgp_orb
