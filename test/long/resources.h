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
#include <filesystem>
#include <fstream>
#include <iterator>
#include <string>
#include <thread>
#include <vector>

#include "robot_testing.h"

/// What a process holds, for long runs in which it must not grow.
namespace ktgp_orb::test {

/// The argument --frames of the program; at least `fewest`, 20 000 without.
inline int soakFrames(int argc, char** argv, int fewest) {
  return std::max(fewest, static_cast<int>(argument(argc, argv, "frames", 20000)));
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

}  // namespace ktgp_orb::test
