// Heap use of a live camera: allocations of the nodelet from the arrival of an image to the
// publication of its matches, by their call site. In steady state only the published messages, and
// ROS when it passes them on, allocate; the matching does not.

#include <cxxabi.h>
#include <dlfcn.h>
#include <execinfo.h>
#include <ktgp_orb/Correspondences.h>
#include <ktgp_orb/HomographyStamped.h>
#include <ktgp_orb/MatchStatistics.h>
#include <ktgp_orb/MatchStatus.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <iostream>
#include <map>
#include <memory>
#include <mutex>

#include "robot_testing.h"
#include "watched_malloc.h"

#ifdef KTGP_ORB_WATCHES_MALLOC

namespace ktgp_orb::test {
namespace {

/// The call stacks of the allocations, and their numbers. Allocates nothing itself.
class StackCounts {
 public:
  struct Stack {
    std::array<void*, 48> frames;
    int depth = 0;
    int count = 0;
  };

  void add() {
    Stack stack;
    stack.depth = backtrace(stack.frames.data(), static_cast<int>(stack.frames.size()));
    const std::lock_guard<std::mutex> lock(mutex_);
    for (int i = 0; i < used_; ++i) {
      if (isSame(stacks_[i], stack)) {
        ++stacks_[i].count;
        return;
      }
    }
    if (used_ == kStacks) {
      full_ = true;
      return;
    }
    stack.count = 1;
    stacks_[used_++] = stack;
  }

  bool full() const { return full_; }
  const Stack* begin() const { return stacks_.data(); }
  const Stack* end() const { return stacks_.data() + used_; }

 private:
  static constexpr int kStacks = 2000;

  static bool isSame(const Stack& a, const Stack& b) {
    return a.depth == b.depth &&
           std::equal(a.frames.begin(), a.frames.begin() + a.depth, b.frames.begin());
  }

  std::mutex mutex_;
  std::array<Stack, kStacks> stacks_;
  int used_ = 0;
  bool full_ = false;
};

StackCounts stacks;
std::atomic<bool> counting{false};
thread_local bool in_count = false;

}  // namespace

void onAllocation() {
  if (!counting || in_count) return;
  in_count = true;
  stacks.add();
  in_count = false;
}

namespace {

/// The name of the function at an address; empty if its library does not have it.
std::string nameOf(void* address) {
  Dl_info info;
  if (dladdr(address, &info) == 0 || info.dli_sname == nullptr) return "";
  int status = 0;
  const std::unique_ptr<char, decltype(&std::free)> name(
      abi::__cxa_demangle(info.dli_sname, nullptr, nullptr, &status), &std::free);
  return status == 0 ? name.get() : info.dli_sname;
}

bool contains(const std::string& text, const std::string& part) {
  return text.find(part) != std::string::npos;
}

/// The purpose of an allocation.
enum class Purpose { other, arrival, matching, making, handing_over };

struct Site {
  Purpose purpose = Purpose::other;
  std::string name;  ///< the innermost function of ours or of ROS
};

/// From the innermost call outwards; the first known function decides.
Site siteOf(const StackCounts::Stack& stack) {
  Site site;
  for (int i = 0; i < stack.depth; ++i) {
    const std::string name = nameOf(stack.frames[static_cast<std::size_t>(i)]);
    const bool ours = contains(name, "ktgp_orb::") && !contains(name, "ktgp_orb::test");
    if (site.name.empty() && (ours || contains(name, "ros::"))) site.name = name;
    const auto is = [&](const char* function) { return contains(name, function); };
    if (is("ktgp_orb::toCorrespondences") || is("ktgp_orb::toHomography") ||
        is("ktgp_orb::toStatistics"))
      site.purpose = Purpose::making;
    // ROS's own publish may be inlined into ours.
    if (is("ros::Publisher::publish") || is("ktgp_orb::MatcherWork::publish")) {
      site.purpose = Purpose::handing_over;
    }
    if (is("ktgp_orb::MatcherNodelet::imageArrived")) site.purpose = Purpose::arrival;
    if (is("ktgp_orb::MatcherWork::process")) site.purpose = Purpose::matching;
    if (site.purpose != Purpose::other) break;
  }
  return site;
}

constexpr int kFrames = 1000;

TEST(RobotHeap, OnlyMessagesAllocate) {
  nodelet::Loader loader(false);
  ASSERT_TRUE(loadMatcher(loader, "/camera"));
  Camera camera("/camera/image_raw", cv::Size(320, 240), 30.0);
  Recorder<MatchStatistics> statistics("/camera/matcher/statistics");
  Recorder<Correspondences> correspondences("/camera/matcher/correspondences");
  Recorder<HomographyStamped> homography("/camera/matcher/homography");
  camera.start();  // until the first image has arrived
  ASSERT_TRUE(statistics.waitForMore(1));
  camera.stop();
  std::map<int, int> statuses;
  const auto run = [&](int frames) {
    for (int i = 0; i < frames; ++i) {
      const ros::Time stamp = camera.publish()->header.stamp;
      ASSERT_TRUE(statistics.waitFor(stamp));
      ++statuses[statistics.messages().back()->status];
      statistics.clear();
      correspondences.messages();
      correspondences.clear();
      homography.messages();
      homography.clear();
    }
  };
  run(100);  // buffers grow
  void* frame[1];
  backtrace(frame, 1);  // its first call allocates
  statuses.clear();
  counting = true;
  run(kFrames);
  counting = false;
  EXPECT_GE(statuses[MatchStatus::STATUS_OK], kFrames * 9 / 10)
      << "statuses: " << testing::PrintToString(statuses);
  ASSERT_FALSE(stacks.full());

  std::map<Purpose, double> per_frame;
  std::map<std::pair<Purpose, std::string>, int> sites;
  for (const StackCounts::Stack& stack : stacks) {
    const Site site = siteOf(stack);
    per_frame[site.purpose] += static_cast<double>(stack.count) / kFrames;
    sites[{site.purpose, site.name}] += stack.count;
  }
  const std::map<Purpose, std::string> names{{Purpose::arrival, "arrival"},
                                             {Purpose::matching, "matching"},
                                             {Purpose::making, "making messages"},
                                             {Purpose::handing_over, "handing over"}};
  std::cout << "allocations a frame:\n";
  for (const auto& [site, count] : sites) {
    if (site.first == Purpose::other) continue;
    std::cout << "  " << names.at(site.first) << ": " << static_cast<double>(count) / kFrames
              << " in " << site.second << '\n';
  }
  EXPECT_EQ(per_frame[Purpose::arrival], 0.0);
  EXPECT_EQ(per_frame[Purpose::matching], 0.0);
  EXPECT_GT(per_frame[Purpose::making], 0.0);    // the attribution works
  EXPECT_LE(per_frame[Purpose::making], 100.0);  // 78: strings and arrays of three messages
  EXPECT_LE(per_frame[Purpose::handing_over], 60.0);
}

}  // namespace
}  // namespace ktgp_orb::test

#endif
