#pragma once

#include <ktgp_orb/TargetDetections.h>
#include <rosbag/bag.h>

#include <fstream>
#include <map>
#include <memory>
#include <string>

#include "files/output_file.h"
#include "ros/message_conversion.h"

namespace ktgp_orb::tools {

/// A stamp as text for a table: "sec.nsec".
std::string textOf(const ros::Time& time);

/// What MatchWriter::close() wrote to a finished bag about the part of the recording that could not
/// be used; empty if all of it could. Throws FileError if the file is not a whole bag.
std::string unusedPartOf(const std::string& bag);

/// Writes the results to a bag, on the topics of the nodelet, and to a table (csv).
class MatchWriter {
 public:
  /// `prefix`: prefix of the topics, for example "/camera/matcher". `csv`: path of the table; "-":
  /// standard output; empty: no table. `outputs` must outlive this object. All functions throw
  /// std::runtime_error if a file cannot be written; the text names the file.
  MatchWriter(const std::string& bag, const std::string& csv, const std::string& prefix,
              files::Outputs& outputs);
  ~MatchWriter();
  MatchWriter(const MatchWriter&) = delete;
  MatchWriter& operator=(const MatchWriter&) = delete;

  void write(const FrameMessages& messages, const ros::Time& time);
  /// `topic`: full name of the topic. `detections`: if null, nothing is written.
  void write(const std::string& topic, const TargetDetectionsPtr& detections,
             const ros::Time& time);
  /// Writes a line to the table, but nothing to the bag, for an image that was not matched.
  /// `status`: "refused" or "repeated".
  void writeUnused(const std_msgs::Header& header, const std::string& status,
                   const std::string& reason);

  /// Completes the bag and the table. `unused`: which part of the recording could not be used. It
  /// is written to the bag, so that later runs know it; empty: all could be used.
  void close(const std::string& unused);

 private:
  template <typename Message>
  void writeMessage(const std::string& topic, const ros::Time& time, Message& message);
  void writeLine(const FrameMessages& messages);

  files::Outputs& outputs_;
  files::OutputFile& bag_file_;
  files::OutputFile* csv_file_ = nullptr;
  std::unique_ptr<rosbag::Bag> bag_;
  std::ofstream csv_text_;
  std::ostream* csv_ = nullptr;                    // stream of the table; null: no table
  std::string prefix_;                             // prefix of the topics, which ends with a slash
  ros::Time last_time_ = ros::TIME_MIN;            // time of the last message in the bag
  std::map<std::string, std::uint32_t> sequence_;  // next header.seq of each topic
};

}  // namespace ktgp_orb::tools
