#include "tools/bag_writer.h"

#include <rosbag/view.h>
#include <std_msgs/String.h>

#include <algorithm>
#include <cmath>
#include <iostream>
#include <stdexcept>

#include "files/csv.h"
#include "files/input.h"
#include "homography/transform.h"
#include "ktgp_orb/ktgp_matcher.h"
#include "ktgp_orb/status.h"
#include "ktgp_orb/two_view.h"
#include "two_view/fields.h"
#include "util/format.h"

namespace ktgp_orb::tools {
namespace {

constexpr int kStages = 4;
constexpr int kExact = 17;  // this many digits reproduce every double exactly
constexpr int kUnknowns = 6;
// Does not depend on --name, which the run that reads it may not know.
constexpr const char* kUnusedTopic = "/ktgp_bag/unused";

/// Names of the columns for one motion of the two-view geometry. `prefix`: beginning of each name.
std::string motionColumns(const std::string& prefix) {
  const char* const axes[kUnknowns] = {"tx", "ty", "tz", "rx", "ry", "rz"};
  std::string text;
  for (const char* const name : {"tx", "ty", "tz", "qx", "qy", "qz", "qw"}) {
    text += prefix + name + ",";
  }
  for (int i = 0; i < kUnknowns; ++i) {
    for (int k = i; k < kUnknowns; ++k) text += prefix + "cov_" + axes[i] + "_" + axes[k] + ",";
  }
  return text;
}

std::string twoViewColumns() {
  std::string text = "doubt,";
  two_view::visitNumbers(
      [&](const two_view::NumberField& field) { text += std::string(field.name) + ","; });
  return text + motionColumns("") + "other_geometry," + motionColumns("other_");
}

std::size_t countOf(const std::string& columns) {
  return static_cast<std::size_t>(std::count(columns.begin(), columns.end(), ','));
}

std::string columns() {
  std::string text =
      "stamp,reference_stamp,status,found_by,geometry,reference_changed,reference_features,"
      "target_features,descriptor,knn,tf,gms,prosac,inliers,retention,mean_distance,rms_distance,"
      "reprojection_rmse,";
  homography::visitNumbers([&](const std::string& name) { text += name + ","; });
  text += "extraction_ms,knn_ms,tf_ms,gms_ms,prosac_ms,growth_ms,guided_ms,align_ms,two_view_ms,";
  return text + "total_ms," + files::kHomographyColumns + "," + twoViewColumns() + "error";
}

void addKnown(double value, files::CsvRow& row) {
  if (std::isfinite(value)) {
    row.add(value);
  } else {
    row.skip(1);
  }
}

void addMotion(const geometry_msgs::PoseWithCovariance& motion, files::CsvRow& row) {
  const auto& t = motion.pose.position;
  const auto& turn = motion.pose.orientation;
  for (const double value : {t.x, t.y, t.z}) row.add(value);
  for (const double value : {turn.x, turn.y, turn.z, turn.w}) row.add(value, kExact);
  for (std::size_t i = 0; i < kUnknowns; ++i) {
    for (std::size_t k = i; k < kUnknowns; ++k) {
      addKnown(motion.covariance[kUnknowns * i + k], row);
    }
  }
}

/// Adds the values of the two-view geometry to the row. Unknown values stay empty.
void addTwoView(const TwoViewGeometry* view, files::CsvRow& row) {
  static const std::size_t motion = countOf(motionColumns(""));
  if (view == nullptr) {
    row.skip(countOf(twoViewColumns()));
    return;
  }
  row.add(toString(static_cast<Doubt>(view->doubt)));
  two_view::visitNumbers(
      [&](const two_view::NumberField& /*field*/, double value) { addKnown(value, row); }, *view);
  if (view->has_pose) {
    addMotion(view->pose, row);
  } else {
    row.skip(motion);
  }
  if (view->other_pose.empty()) {
    row.skip(1 + motion);
  } else {
    row.add(toString(static_cast<Geometry>(view->other_geometry)));
    addMotion(view->other_pose.front(), row);
  }
}

}  // namespace

std::string textOf(const ros::Time& time) {
  return util::format("%u.%09u", time.sec, time.nsec);
}

std::string unusedPartOf(const std::string& bag) {
  try {
    const rosbag::Bag finished(bag, rosbag::bagmode::Read);
    rosbag::View messages(finished, rosbag::TopicQuery(kUnusedTopic));
    for (const rosbag::MessageInstance& message : messages) {
      const auto text = message.instantiate<std_msgs::String>();
      if (text) return text->data;
    }
  } catch (const std::exception& error) {
    throw files::FileError(bag, std::string("is not a whole bag (") + error.what() +
                                    "); expected one of an earlier run, or a new name");
  }
  return {};
}

MatchWriter::MatchWriter(const std::string& bag, const std::string& csv, const std::string& prefix,
                         files::Outputs& outputs)
    : outputs_(outputs), bag_file_(outputs.add(bag)), prefix_(prefix + "/") {
  const bool to_file = !csv.empty() && !files::isStandardOutput(csv);
  if (to_file) csv_file_ = &outputs.add(csv);
  try {
    bag_ = std::make_unique<rosbag::Bag>(bag_file_.unfinished(), rosbag::bagmode::Write);
  } catch (const rosbag::BagException& error) {
    files::throwUnwritable(bag_file_, error.what());
  }
  if (csv.empty()) return;
  if (to_file) csv_text_.open(csv_file_->unfinished());
  csv_ = to_file ? static_cast<std::ostream*>(&csv_text_) : &std::cout;
  *csv_ << columns() << '\n';
}

MatchWriter::~MatchWriter() {
  // Close the bag here, where we can catch the exception: if the disk is full, close() throws, and
  // in the destructor of the bag this would end the program.
  try {
    if (bag_) bag_->close();
  } catch (const std::exception&) {
    static_cast<void>(bag_.release());
  }
}

void MatchWriter::close(const std::string& unused) {
  try {
    if (!unused.empty()) {
      std_msgs::String text;
      text.data = unused;
      bag_->write(kUnusedTopic, last_time_, text);
    }
    bag_->close();
  } catch (const rosbag::BagException& error) {
    files::throwUnwritable(bag_file_, error.what());
  }
  if (csv_file_ != nullptr) {
    csv_text_.close();
    if (!csv_text_) files::throwUnwritable(*csv_file_, "an earlier part of it could not");
    outputs_.complete(*csv_file_);
  }
  outputs_.complete(bag_file_);
}

template <typename Message>
void MatchWriter::writeMessage(const std::string& topic, const ros::Time& time, Message& message) {
  message.header.seq = sequence_[topic]++;  // number the messages of a topic, as a publisher does
  try {
    // A recorded time may be zero, which rosbag does not write.
    last_time_ = std::max(ros::TIME_MIN, time);
    bag_->write(topic, last_time_, message);
  } catch (const rosbag::BagException& error) {
    files::throwUnwritable(bag_file_, error.what());
  }
}

void MatchWriter::write(const FrameMessages& messages, const ros::Time& time) {
#define KTGP_TOPIC(name, Message, make, text) \
  if (messages.name) writeMessage(prefix_ + #name, time, *messages.name);
#define KTGP_LIVE_TOPIC(name, Message, make, text)
#include "ros/topics.def"
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
  constexpr int kTime = 5;  // significant digits of a time in ms
  const MatchStatistics& s = *messages.statistics;
  files::CsvRow row;
  row.add(textOf(s.header.stamp)).add(textOf(s.reference_stamp));
  row.add(toString(static_cast<Status>(s.status))).add(toString(static_cast<FoundBy>(s.found_by)));
  row.add(toString(static_cast<Geometry>(s.geometry)));
  row.add(int(s.reference_changed)).add(s.reference_features).add(s.target_features);
  row.add(s.descriptor);
  for (int i = 0; i < kStages; ++i) row.add(s.stages[i].output);
  row.add(s.inliers)
      .add(s.retention)
      .add(s.mean_distance)
      .add(s.rms_distance)
      .add(s.reprojection_rmse);
  homography::visitNumbers([&](const char* /*name*/, double value) { row.add(value); }, s);
  row.add(s.extraction_milliseconds, kTime);
  // The message has the stages in the order of StageId, without those that are off.
  auto stage = s.stages.begin();
  for (int id = 0; id <= static_cast<int>(StageId::two_view); ++id) {
    if (stage != s.stages.end() && stage->name == toString(static_cast<StageId>(id))) {
      row.add((stage++)->milliseconds, kTime);
    } else {
      row.skip(1);
    }
  }
  row.add(s.total_milliseconds, kTime);
  for (const double h : messages.homography->homography) row.add(h, kExact);
  addTwoView(messages.two_view.get(), row);
  *csv_ << row.skip(1).line();
  if (csv_file_ != nullptr && !*csv_)
    files::throwUnwritable(*csv_file_, "an earlier part of it could not");
}

void MatchWriter::writeUnused(const std_msgs::Header& header, const std::string& status,
                              const std::string& reason) {
  if (csv_ == nullptr) return;
  const std::size_t after_status = countOf(columns()) - 3;
  files::CsvRow row;
  *csv_ << row.add(textOf(header.stamp)).skip(1).add(status).skip(after_status).add(reason).line();
}

}  // namespace ktgp_orb::tools
