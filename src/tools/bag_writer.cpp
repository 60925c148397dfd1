#include "tools/bag_writer.h"

#include <iomanip>
#include <iostream>
#include <sstream>
#include <stdexcept>

#include "cli/files.h"
#include "ktgp_orb/ktgp_matcher.h"
#include "ktgp_orb/status.h"

namespace ktgp_orb {
namespace {

constexpr const char* kColumns =
    "stamp,reference_stamp,status,found_by,reference_changed,reference_features,target_features,"
    "descriptor,"
    "knn,tf,gms,prosac,retention,mean_distance,rms_distance,reprojection_rmse,plane_deviation,"
    "extraction_ms,knn_ms,tf_ms,gms_ms,prosac_ms,total_ms,"
    "h00,h01,h02,h10,h11,h12,h20,h21,h22,error";
constexpr int kStages = 4;
constexpr int kColumnsAfterStatus = 29;  // without the error

/// Not written directly to the file: ROS changes the stream's locale, which flushes the buffer, and
/// ends the program if the disk is full.
std::string text(const ros::Time& time) {
  std::ostringstream out;
  out << time;
  return out.str();
}

}  // namespace

MatchWriter::MatchWriter(const std::string& bag, const std::string& csv, const std::string& prefix,
                         bool force)
    : bag_file_(bag, force), prefix_(prefix + "/") {
  const bool to_file = !csv.empty() && !tools::isStandardOutput(csv);
  if (to_file) csv_file_.emplace(csv, force);
  try {
    bag_ = std::make_unique<rosbag::Bag>(bag_file_.unfinished(), rosbag::bagmode::Write);
  } catch (const rosbag::BagException& error) {
    tools::throwUnwritable(bag_file_, error.what());
  }
  if (csv.empty()) return;
  if (to_file) csv_text_.open(csv_file_->unfinished());
  csv_ = to_file ? static_cast<std::ostream*>(&csv_text_) : &std::cout;
  *csv_ << kColumns << '\n';
}

MatchWriter::~MatchWriter() {
  // Its destructor closes it and throws if the disk is full, which would end the program.
  try {
    if (bag_) bag_->close();
  } catch (const std::exception&) {
    static_cast<void>(bag_.release());
  }
}

void MatchWriter::close() {
  try {
    bag_->close();
  } catch (const rosbag::BagException& error) {
    tools::throwUnwritable(bag_file_, error.what());
  }
  if (csv_file_) {
    csv_text_.close();
    if (!csv_text_) tools::throwUnwritable(*csv_file_, "an earlier part of it could not");
    csv_file_->commit();
  }
  bag_file_.commit();
}

template <typename Message>
void MatchWriter::writeMessage(const std::string& topic, const ros::Time& time, Message& message) {
  message.header.seq = sequence_[topic]++;  // like a publisher
  try {
    bag_->write(topic, time, message);
  } catch (const rosbag::BagException& error) {
    tools::throwUnwritable(bag_file_, error.what());
  }
}

void MatchWriter::write(const FrameMessages& messages, const ros::Time& time) {
#define KTGP_TOPIC(name, Message, make, text) \
  if (messages.name) writeMessage(prefix_ + #name, time, *messages.name);
#define KTGP_LIVE_TOPIC(name, Message, make, text)
#include "messages/topics.def"
#undef KTGP_TOPIC
#undef KTGP_LIVE_TOPIC
  if (messages.overlay) writeMessage(prefix_ + "matches_image", time, *messages.overlay);
  if (csv_ != nullptr) writeLine(messages);
}

void MatchWriter::write(const std::string& topic, const TargetDetectionsPtr& detections,
                        const ros::Time& time) {
  if (detections) writeMessage(topic, time, *detections);
}

void MatchWriter::writeLine(const FrameMessages& messages) {
  const MatchStatistics& s = *messages.statistics;
  std::ostream& out = *csv_;
  out << text(s.header.stamp) << ',' << text(s.reference_stamp) << ','
      << toString(static_cast<Status>(s.status)) << ','
      << toString(static_cast<FoundBy>(s.found_by)) << ',' << int(s.reference_changed) << ','
      << s.reference_features << ',' << s.target_features << ',' << s.descriptor;
  for (int i = 0; i < kStages; ++i) out << ',' << s.stages[i].output;
  out << std::setprecision(9) << ',' << s.retention << ',' << s.mean_distance << ','
      << s.rms_distance << ',' << s.reprojection_rmse << ',' << s.plane_deviation;
  out << std::setprecision(5) << ',' << s.extraction_milliseconds;
  for (int i = 0; i < kStages; ++i) {
    out << ',' << s.stages[i].milliseconds;
  }
  out << ',' << s.total_milliseconds << std::setprecision(17);
  for (const double h : messages.homography->homography) out << ',' << h;
  out << ",\n";
  if (csv_file_ && !out) tools::throwUnwritable(*csv_file_, "an earlier part of it could not");
}

void MatchWriter::writeRefused(const std_msgs::Header& header, const std::string& reason) {
  if (csv_ == nullptr) return;
  std::string quoted = reason;
  for (std::size_t i = 0; (i = quoted.find('"', i)) != std::string::npos; i += 2) {
    quoted.insert(i, 1, '"');
  }
  *csv_ << text(header.stamp) << ",,refused" << std::string(kColumnsAfterStatus, ',') << ",\""
        << quoted << "\"\n";
}

}  // namespace ktgp_orb
