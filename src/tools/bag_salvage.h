#pragma once

#include <ros/time.h>

#include <cstddef>
#include <cstdint>
#include <fstream>
#include <map>
#include <optional>
#include <string>
#include <vector>

namespace ktgp_orb {

/// A serialised message of a bag.
struct SalvagedMessage {
  std::string topic;
  std::string type;
  ros::Time time;
  std::vector<std::uint8_t> data;
};

bool isImageType(const std::string& type);

/// Reads a bag (format 2.0, http://wiki.ros.org/Bags/Format/2.0) from its beginning, record by
/// record, without the index that rosbag needs and a cut-off recording lacks.
class BagRecords {
 public:
  /// Throws UnusableBag for a file that cannot be read or is no bag of format 2.0.
  explicit BagRecords(const std::string& path);

  /// The next message, or nothing at the end or at the first damage.
  std::optional<SalvagedMessage> next();

  /// What ended the reading before the end of the file, and where; empty: nothing did.
  const std::string& damage() const { return damage_; }

 private:
  using Bytes = std::vector<std::uint8_t>;
  using Fields = std::map<std::string, std::string>;
  struct Record {
    Fields fields;
    Bytes data;
    bool complete = true;
  };
  struct Connection {
    std::string topic;
    std::string type;
  };

  std::optional<Record> readRecord();
  std::optional<Bytes> read(std::size_t size);
  void openChunk(Record& chunk);
  std::optional<Record> nextInChunk();
  void addConnection(const Record& record);
  std::optional<SalvagedMessage> messageFrom(Record& record) const;
  void setDamage(const std::string& what);

  std::ifstream file_;
  std::size_t file_size_ = 0;
  Bytes chunk_;  // decompressed
  std::size_t chunk_position_ = 0;
  std::map<std::uint32_t, Connection> connections_;
  std::string damage_;
};

}  // namespace ktgp_orb
