#include "bag/messages.h"

#include <algorithm>
#include <iterator>

namespace ktgp_orb {
namespace {

/// Limited to the range of times.
ros::Time later(const ros::Time& time, double seconds) {
  if (time.toSec() + seconds >= ros::TIME_MAX.toSec()) return ros::TIME_MAX;
  return time + ros::Duration(seconds);
}

}  // namespace

BagMessages::BagMessages(const std::string& path) : file_(path) {}

std::set<bag::Topic> BagMessages::topics() const {
  std::set<bag::Topic> all;
  for (const auto& connection : file_.connections()) {
    all.insert(connection.second.begin(), connection.second.end());
  }
  return all;
}

void BagMessages::select(const Wanted& wanted, double start, double duration) {
  for (const auto& [connection, topics] : file_.connections()) {
    for (const bag::Topic& topic : topics) {
      if (wanted(topic)) connections_[connection].insert(topic);
    }
  }
  ros::Time first = ros::TIME_MAX;
  for (const bag::Chunk& chunk : file_.chunks()) {
    for (const auto& of : chunk.times) {
      for (const ros::Time& time : of.second) first = std::min(first, time);
    }
  }
  begin_ = later(first, start);
  end_ = duration < 0.0 ? ros::TIME_MAX : later(begin_, duration);
  for (std::size_t i = 0; i < file_.chunks().size(); ++i) {
    const std::vector<ros::Time> times = wantedTimes(file_.chunks()[i]);
    if (times.empty()) continue;
    total_ += times.size();
    order_.emplace_back(*std::min_element(times.begin(), times.end()), i);
  }
  std::sort(order_.begin(), order_.end());
}

std::optional<RecordedMessage> BagMessages::next() {
  while (true) {
    while (unread_ < order_.size() &&
           (queue_.empty() || order_[unread_].first <= std::get<0>(queue_.begin()->first))) {
      enqueue(order_[unread_++].second);
    }
    if (queue_.empty()) return std::nullopt;
    const auto [time, chunk, number] = queue_.begin()->first;
    const std::uint32_t connection = queue_.begin()->second;
    queue_.erase(queue_.begin());
    current_ = contentsOf(chunk);
    if (number >= current_->messages.size()) continue;  // the message was readable before
    ++read_;
    return RecordedMessage{connections_.at(connection), time, current_->messages[number].data};
  }
}

void BagMessages::reject(const std::string& what) {
  --read_;
  file_.note(what);
}

std::string BagMessages::damage(const std::string& things) const {
  const std::string what = file_.damage();
  std::size_t lost = expected_ - std::min(expected_, read_);
  for (const auto& of : file_.missing()) lost += connections_.count(of.first) > 0 ? of.second : 0;
  if (lost > 0) return std::to_string(lost) + " " + things + " lost; " + what;
  if (what.empty()) return what;
  if (file_.hasIndex()) return "no " + things + " known to be lost; " + what;
  return "how many " + things + " are lost is not known, since the index at the end is missing; " +
         what;
}

std::vector<ros::Time> BagMessages::wantedTimes(const bag::Chunk& chunk) const {
  std::vector<ros::Time> wanted;
  for (const auto& connection : connections_) {
    const auto times = chunk.times.find(connection.first);
    if (times == chunk.times.end()) continue;
    std::copy_if(times->second.begin(), times->second.end(), std::back_inserter(wanted),
                 [this](const ros::Time& time) { return isWanted(time); });
  }
  return wanted;
}

void BagMessages::enqueue(std::size_t chunk) {
  const ContentsPtr contents = contentsOf(chunk);
  std::vector<ros::Time> found;
  for (std::size_t i = 0; i < contents->messages.size(); ++i) {
    const bag::Message& message = contents->messages[i];
    if (connections_.count(message.connection) == 0 || !isWanted(message.time)) continue;
    queue_[{message.time, chunk, i}] = message.connection;
    found.push_back(message.time);
  }
  std::vector<ros::Time> indexed = wantedTimes(file_.chunks()[chunk]);
  expected_ += std::max(indexed.size(), found.size());
  std::sort(indexed.begin(), indexed.end());
  std::sort(found.begin(), found.end());
  if (indexed != found) {
    file_.note("the index and the messages differ in the chunk at byte " +
               std::to_string(file_.chunks()[chunk].position));
  }
}

/// The last few chunks are kept, since the messages of several may alternate.
BagMessages::ContentsPtr BagMessages::contentsOf(std::size_t chunk) {
  constexpr std::size_t kKept = 4;
  for (const auto& kept : kept_) {
    if (kept.first == chunk) return kept.second;
  }
  kept_.emplace_back(chunk,
                     std::make_shared<const bag::ChunkContents>(file_.read(file_.chunks()[chunk])));
  if (kept_.size() > kKept) kept_.pop_front();
  return kept_.back().second;
}

}  // namespace ktgp_orb
