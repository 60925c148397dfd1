#pragma once

#include <malloc.h>
#include <netinet/in.h>
#include <ros/ros.h>
#include <ros/xmlrpc_manager.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cstddef>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <optional>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "robot_testing.h"

/// Resources of a process, for long runs in which they must not grow.
namespace ktgp_orb::test {

/// The argument --frames of the program; at least `fewest`, 20 000 without.
inline int soakFrames(int fewest) {
  return std::max(fewest, argument("frames", 20000));
}

/// The resources of the process.
struct Held {
  double megabytes = 0.0;
  double heap = 0.0;  // MB in use
  int descriptors = 0;
  int threads = 0;
};

inline int entries(const char* folder) {
  const auto all = std::filesystem::directory_iterator(folder);
  return static_cast<int>(std::distance(begin(all), end(all)));
}

/// One end of a connection; 0 for an unknown one.
inline int port(int descriptor, decltype(getpeername)* end) {
  sockaddr_in address{};
  socklen_t size = sizeof(address);
  if (end(descriptor, reinterpret_cast<sockaddr*>(&address), &size) != 0) return 0;
  return address.sin_family == AF_INET ? ntohs(address.sin_port) : 0;
}

/// Without connections of XML-RPC calls, to the master and from this process to itself: roscpp
/// keeps as many as there were simultaneous calls, which depends on the load of the machine.
inline int descriptors() {
  const int master = static_cast<int>(ros::master::getPort());
  const int own = ros::XMLRPCManager::instance()->getServerPort();
  int count = 0;
  for (const auto& entry : std::filesystem::directory_iterator("/proc/self/fd")) {
    const int descriptor = std::stoi(entry.path().filename());
    const int here = port(descriptor, getsockname), there = port(descriptor, getpeername);
    count += here != own && there != own && there != master ? 1 : 0;
  }
  return count;
}

inline double heapInUse() {
#if __GLIBC_PREREQ(2, 33)
  const struct mallinfo2 info = mallinfo2();
  return static_cast<double>(info.uordblks + info.hblkhd) / 1e6;
#else
  return 0.0;
#endif
}

inline Held held() {
  malloc_trim(0);  // freed memory is not growth
  std::size_t size = 0, resident = 0;
  std::ifstream("/proc/self/statm") >> size >> resident;
  return {static_cast<double>(resident) * static_cast<double>(sysconf(_SC_PAGESIZE)) / 1e6,
          heapInUse(), descriptors(), entries("/proc/self/task")};
}

/// As soon as there are no more descriptors and threads than at `before`, or after ten seconds:
/// ROS's own threads close connections later.
inline Held heldAtRest(const Held& before) {
  const auto end = std::chrono::steady_clock::now() + std::chrono::seconds(10);
  Held now = held();
  while ((now.descriptors > before.descriptors || now.threads > before.threads) &&
         std::chrono::steady_clock::now() < end) {
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
    now = held();
  }
  return now;
}

/// The median over the last quarter of the values minus that over the second one.
inline double growth(const std::vector<double>& values) {
  const auto median = [&](std::size_t quarter) {
    const auto at = [&](std::size_t q) {
      return values.begin() + static_cast<std::ptrdiff_t>(q * values.size() / 4);
    };
    std::vector<double> part(at(quarter), at(quarter + 1));
    std::sort(part.begin(), part.end());
    return part.at(part.size() / 2);
  };
  return median(3) - median(1);
}

/// Resources of the process after each cycle of a long run.
class Course {
 public:
  /// `is_warm`: from now on, its files and threads may not become more.
  const Held& add(bool is_warm) {
    last_ = held();
    megabytes_.push_back(last_.megabytes);
    heap_.push_back(last_.heap);
    if (warm_) last_ = heldAtRest(*warm_);
    if (!warm_ && is_warm) warm_ = last_;
    return last_;
  }

  void judge(double heap_limit, double growth_limit) const {
    const double process = growth(megabytes_);
    const double heap = growth(heap_);
    std::printf(
        "from the second quarter to the last (medians) %+.3f MB in use (limit %+.1f), %+.1f MB of "
        "the process (limit %+.1f); since the first %+d files, %+d threads\n",
        heap, heap_limit, process, growth_limit, last_.descriptors - warm_->descriptors,
        last_.threads - warm_->threads);
    EXPECT_LT(heap, heap_limit);
    EXPECT_LT(process, growth_limit);
    EXPECT_LE(last_.descriptors, warm_->descriptors);
    EXPECT_LE(last_.threads, warm_->threads);
  }

 private:
  std::optional<Held> warm_;
  Held last_;
  std::vector<double> megabytes_, heap_;
};

/// The stamp contains the number of the frame, so that the answer can be identified.
inline ros::Time stampOf(int number) {
  return {1000U + static_cast<std::uint32_t>(number) / 50U,
          static_cast<std::uint32_t>(number) % 50U * 20000000U};
}

/// Sends images one at a time and waits for the answer to each.
template <typename Answer>
class Feeder {
 public:
  using Ptr = boost::shared_ptr<const Answer>;

  Feeder(const std::string& camera, std::string answers)
      : answers_(std::move(answers)),
        publisher_(ros::NodeHandle().advertise<sensor_msgs::Image>(camera + "image_raw", 1)) {
    node_.setCallbackQueue(&queue_);
  }

  /// Waits until the nodelet is loaded and both are subscribed.
  bool connect() {
    subscriber_ =
        node_.subscribe<Answer>(answers_, 0, [this](const Ptr& answer) { newest_ = answer; });
    return waitUntil([this] {
      return publisher_.getNumSubscribers() == 1 && subscriber_.getNumPublishers() == 1;
    });
  }
  /// Waits until the nodelet listens no more.
  bool disconnect() {
    subscriber_.shutdown();
    return waitUntil([this] { return publisher_.getNumSubscribers() == 0; });
  }

  /// The answer, or null after a while.
  Ptr show(const sensor_msgs::ImagePtr& image) {
    const ros::Time stamp = image->header.stamp;
    const auto begin = std::chrono::steady_clock::now();
    publisher_.publish(image);
    const auto end = begin + std::chrono::duration<double>(kTimeout);
    while (!newest_ || newest_->header.stamp != stamp) {
      queue_.callAvailable(ros::WallDuration(0.05));
      if (std::chrono::steady_clock::now() > end) return nullptr;
    }
    const auto took = std::chrono::steady_clock::now() - begin;
    ms_.push_back(std::chrono::duration<double, std::milli>(took).count());
    return newest_;
  }

  /// Figures of the answers since the last call: their number, and their median, 99th percentile
  /// and largest time in ms.
  struct Times {
    double count, p50, p99, max;
  };
  Times times() {
    std::sort(ms_.begin(), ms_.end());
    const auto at = [&](double share) {
      return ms_[static_cast<std::size_t>(share * static_cast<double>(ms_.size() - 1))];
    };
    const Times times{static_cast<double>(ms_.size()), at(0.5), at(0.99), at(1.0)};
    ms_.clear();
    return times;
  }

 private:
  std::string answers_;
  ros::CallbackQueue queue_;
  ros::NodeHandle node_;
  ros::Publisher publisher_;
  ros::Subscriber subscriber_;
  Ptr newest_;
  std::vector<double> ms_;
};

}  // namespace ktgp_orb::test
