// Single images on their way through the nodelet.

#include <diagnostic_msgs/DiagnosticArray.h>
#include <ktgp_orb/HomographyStamped.h>
#include <ktgp_orb/Match.h>
#include <ktgp_orb/MatchStatistics.h>
#include <ktgp_orb/MatchStatus.h>
#include <std_srvs/Trigger.h>

#include <cstdint>
#include <map>
#include <opencv2/core/utility.hpp>
#include <utility>

#include "robot_testing.h"

namespace ktgp_orb {
namespace {

using test::Recorder;
using test::waitUntil;

const std::string kMatcher = "/camera/matcher/";

using Reports = Recorder<diagnostic_msgs::DiagnosticArray>;

/// Calls a function for the report of each task so far.
void forEach(Reports& reports,
             const std::function<void(const diagnostic_msgs::DiagnosticStatus&)>& act) {
  for (const auto& report : reports.messages()) {
    for (const auto& status : report->status) act(status);
  }
}

/// The messages of all tasks so far.
std::string anyMessage(Reports& reports) {
  std::string all;
  forEach(reports, [&](const auto& status) { all += status.message + "\n"; });
  return all;
}

/// The matcher's last report about its input.
std::string inputMessage(Reports& reports) {
  std::string last;
  forEach(reports, [&](const auto& status) {
    const std::string& name = status.name;
    if (name.size() > 7 && name.substr(name.size() - 7) == ": input") last = status.message;
  });
  return last;
}

/// A value of the last report that contains it.
std::string diagnosticValue(Reports& reports, const std::string& key) {
  std::string found;
  forEach(reports, [&](const auto& status) {
    for (const auto& value : status.values) {
      if (value.key == key) found = value.value;
    }
  });
  return found;
}

class Stream : public testing::Test {
 protected:
  void TearDown() override { loader_.clear(); }

  void load(const std::string& reference_mode = "previous") {
    ros::param::set(kMatcher + "reference_mode", reference_mode);
    ASSERT_TRUE(test::loadMatcher(loader_, "/camera"));
    ASSERT_TRUE(waitUntil([&] { return publisher_.getNumSubscribers() > 0; }));
  }

  sensor_msgs::ImagePtr view(const cv::Size& size = {320, 240}) {
    ++count_;
    return test::View(size).image(count_, ros::Time(1000.0 + 0.1 * count_));
  }

  /// The statistics of an image that is sent now.
  MatchStatistics send(const sensor_msgs::ImagePtr& image) {
    publisher_.publish(sensor_msgs::ImageConstPtr(image));
    const ros::Time stamp = image->header.stamp;
    const bool arrived = statistics_.waitFor(stamp);
    EXPECT_TRUE(arrived);
    return arrived ? *statistics_.withStamp(stamp) : MatchStatistics();
  }

  static std_srvs::Trigger::Response call(const std::string& service) {
    std_srvs::Trigger call;
    EXPECT_TRUE(ros::service::call(kMatcher + service, call));
    return call.response;
  }

  ros::Publisher publisher_ =
      ros::NodeHandle().advertise<sensor_msgs::Image>("/camera/image_raw", 10);
  nodelet::Loader loader_{false};
  Recorder<MatchStatistics> statistics_{kMatcher + "statistics"};
  int count_ = 0;
};

TEST_F(Stream, LostImagesAreCountedByTheirNumbers) {
  Reports reports("/diagnostics");
  load();
  const auto numbered = [&](std::uint32_t number) {
    const sensor_msgs::ImagePtr image = view();
    image->header.seq = number;
    return image;
  };
  const auto sendNumbered = [&](std::uint32_t number) {
    return send(numbered(number)).lost_frames;
  };
  // Until the matcher has counted who publishes, which it does between two reports: with two of
  // them the numbers would tell nothing.
  ASSERT_TRUE(reports.waitForMore(3));
  EXPECT_EQ(sendNumbered(70), 0U) << "what came before the subscription was not lost";
  EXPECT_EQ(sendNumbered(71), 0U);
  EXPECT_EQ(sendNumbered(75), 3U);
  EXPECT_EQ(sendNumbered(76), 3U);
  EXPECT_EQ(sendNumbered(5), 3U) << "the publisher restarted";
  EXPECT_EQ(sendNumbered(7), 4U);
  call("pause");
  const sensor_msgs::ImageConstPtr unseen = numbered(9);
  publisher_.publish(unseen);
  ASSERT_TRUE(waitUntil([&] { return unseen.use_count() == 1; })) << "it arrives";
  call("resume");
  EXPECT_EQ(sendNumbered(10), 4U) << "images lost while paused do not count";
  EXPECT_EQ(sendNumbered(4000000), 4U) << "another counter";
  EXPECT_EQ(sendNumbered(0), 4U);
  EXPECT_EQ(sendNumbered(0), 4U) << "a publisher that does not count";
  // A throttled topic is not an overload.
  EXPECT_EQ(statistics_.messages().back()->dropped_frames, 0U);
  reports.messages();
  reports.clear();
  EXPECT_TRUE(waitUntil([&] { return inputMessage(reports) == "images arrive"; }));
}

// The frame is lost with the process, but that it existed is known.
TEST_F(Stream, RestartReportsTheLostReference) {
  Reports reports("/diagnostics");
  const auto said = [&] {
    return anyMessage(reports).find("the reference that ~set_reference took is lost") !=
           std::string::npos;
  };
  load("fixed");
  send(view());
  ASSERT_TRUE(call("set_reference").success);
  EXPECT_EQ(send(view()).status, MatchStatus::STATUS_OK);
  ASSERT_TRUE(waitUntil([] { return ros::param::has(kMatcher + "reference_was_set"); }));
  EXPECT_FALSE(said());
  loader_.clear();
  load("fixed");
  EXPECT_EQ(send(view()).reason, MatchStatus::REASON_NOT_SET);
  EXPECT_TRUE(waitUntil(said));
  EXPECT_TRUE(call("reset").success);
  reports.clear();
  ASSERT_TRUE(waitUntil([&] {
    reports.messages();
    const bool quiet = !reports.messages().empty() && !said();
    reports.clear();
    return quiet;
  }));
  EXPECT_FALSE(ros::param::has(kMatcher + "reference_was_set"));
}

TEST_F(Stream, SetReferenceTakesAnImageThatArrivesAfterTheCall) {
  ros::param::set(kMatcher + "queue_size", 10);  // no image is lost before it arrives
  load("fixed");
  ros::param::del(kMatcher + "queue_size");
  send(view());
  for (int trial = 0; trial < 5; ++trial) {
    EXPECT_TRUE(call("reset").success);
    // The worker is busy with a large image while others arrive. The first of them is released when
    // the second one has replaced it, or has been matched after it.
    publisher_.publish(sensor_msgs::ImageConstPtr(view({2560, 1920})));
    const sensor_msgs::ImageConstPtr replaced = view();
    const sensor_msgs::ImageConstPtr before = view();
    publisher_.publish(replaced);
    publisher_.publish(before);
    ASSERT_TRUE(waitUntil([&] {
      return replaced.use_count() == 1 || statistics_.withStamp(before->header.stamp) != nullptr;
    })) << "it arrives";
    const auto answer = call("set_reference");
    ASSERT_TRUE(answer.success) << answer.message;
    ASSERT_TRUE(statistics_.waitFor(before->header.stamp));
    EXPECT_EQ(statistics_.withStamp(before->header.stamp)->reason, MatchStatus::REASON_NOT_SET);
    const MatchStatistics after = send(view());
    EXPECT_EQ(after.reference_stamp, after.header.stamp);
  }
}

TEST_F(Stream, SetReferenceIsRefusedWhereItWouldDoNothing) {
  load("previous");
  send(view());
  auto answer = call("set_reference");
  EXPECT_FALSE(answer.success);
  EXPECT_NE(answer.message.find("reference_mode is not fixed"), std::string::npos);
  loader_.clear();
  load("fixed");
  send(view());
  call("pause");
  answer = call("set_reference");
  EXPECT_FALSE(answer.success);
  EXPECT_NE(answer.message.find("paused"), std::string::npos);
  call("resume");
  EXPECT_TRUE(call("set_reference").success);
}

TEST(StreamWithoutSubscribers, SetReferenceIsRefused) {
  ros::param::set(kMatcher + "reference_mode", "fixed");
  nodelet::Loader loader(false);
  ASSERT_TRUE(test::loadMatcher(loader, "/camera"));
  std_srvs::Trigger call;
  ASSERT_TRUE(ros::service::call(kMatcher + "set_reference", call));
  EXPECT_FALSE(call.response.success);
  EXPECT_NE(call.response.message.find("idle"), std::string::npos);
}

TEST_F(Stream, EveryFrameHasAHomographyMessageWithTheReason) {
  Recorder<HomographyStamped> homographies(kMatcher + "homography");
  load();
  const auto expect = [&](const MatchStatistics& statistics, int reason) {
    EXPECT_EQ(statistics.reason, reason);
    EXPECT_EQ(statistics.status == MatchStatus::STATUS_NO_REFERENCE,
              reason != MatchStatus::REASON_NONE);
    ASSERT_EQ(statistics.stages.size(), 5U);
    const char* const names[] = {"knn", "tf", "gms", "prosac", "align"};
    for (int i = 0; i < 5; ++i) EXPECT_EQ(statistics.stages[i].name, names[i]);
    EXPECT_EQ(statistics.kt, statistics.stages[1].output);
    EXPECT_EQ(statistics.ktg, statistics.stages[2].output);
    EXPECT_EQ(statistics.stages[3].output > 0, reason == MatchStatus::REASON_NONE);
    EXPECT_EQ(statistics.inliers > 0, reason == MatchStatus::REASON_NONE);
    ASSERT_TRUE(homographies.waitFor(statistics.header.stamp));
    const HomographyStamped& homography = *homographies.withStamp(statistics.header.stamp);
    EXPECT_EQ(homography.status, statistics.status);
    EXPECT_EQ(homography.reason, reason);
    EXPECT_EQ(homography.inliers, statistics.inliers) << "of the published homography";
  };
  expect(send(view()), MatchStatus::REASON_FIRST_FRAME);
  expect(send(view()), MatchStatus::REASON_NONE);
  expect(send(view({240, 320})), MatchStatus::REASON_SIZE_CHANGED);
  expect(send(view({240, 320})), MatchStatus::REASON_NONE);
  count_ += 11;
  expect(send(view({240, 320})), MatchStatus::REASON_GAP);
  expect(send(view({240, 320})), MatchStatus::REASON_NONE);  // else the stamp was ahead
  count_ -= 5;
  expect(send(view({240, 320})), MatchStatus::REASON_STAMP_WENT_BACK);
  call("reset");
  expect(send(view({240, 320})), MatchStatus::REASON_RESET);
}

// Both topics in one queue, in the order of publication.
TEST_F(Stream, TheDataDoNotWaitForTheOverlay) {
  ros::CallbackQueue queue;
  ros::NodeHandle node;
  node.setCallbackQueue(&queue);
  std::vector<std::pair<char, ros::Time>> order;
  const ros::Subscriber data = node.subscribe<MatchStatistics>(
      kMatcher + "statistics", 0, [&](const MatchStatistics::ConstPtr& message) {
        order.emplace_back('s', message->header.stamp);
      });
  const ros::Subscriber overlay = node.subscribe<sensor_msgs::Image>(
      kMatcher + "matches_image", 0, [&](const sensor_msgs::Image::ConstPtr& message) {
        order.emplace_back('o', message->header.stamp);
      });
  load();
  ASSERT_TRUE(waitUntil([&] { return overlay.getNumPublishers() > 0; }));
  for (int i = 0; i < 5; ++i) {
    const ros::Time stamp = send(view()).header.stamp;
    ASSERT_TRUE(waitUntil([&] {
      queue.callAvailable();
      return !order.empty() && order.back() == std::make_pair('o', stamp);
    })) << "an overlay of every frame, of the first one too";
    ASSERT_GE(order.size(), 2U);
    EXPECT_EQ(order[order.size() - 2], std::make_pair('s', stamp));
  }
}

/// A callback queue that first runs a function, in the publishing thread.
class Tap : public ros::CallbackQueueInterface {
 public:
  explicit Tap(std::function<void()> act) : act_(std::move(act)) {}

  void addCallback(const ros::CallbackInterfacePtr& /*callback*/, std::uint64_t /*id*/) override {
    act_();
  }
  void removeByID(std::uint64_t /*id*/) override {}

  template <typename Message>
  ros::Subscriber subscribe(const std::string& topic) {
    auto options = ros::SubscribeOptions::create<Message>(
        topic, 0, [](const boost::shared_ptr<const Message>&) {}, ros::VoidPtr(), this);
    return ros::NodeHandle().subscribe(options);
  }

 private:
  std::function<void()> act_;
};

// While the data of a frame are published, the next frame arrives: the matcher is always late.
TEST_F(Stream, TheOverlayOfAnOldFrameIsSkippedWhereANewerOneWaits) {
  std::mutex mutex;
  std::string order;  // s: statistics, o: overlay
  const auto note = [&](char what) {
    const std::lock_guard<std::mutex> lock(mutex);
    order += what;
  };
  const auto contains = [&](const std::string& wanted) {
    const std::lock_guard<std::mutex> lock(mutex);
    return order.find(wanted) != std::string::npos || order.size() > 2000;
  };
  std::atomic<bool> behind{true};
  Tap data([&] {
    note('s');
    if (!behind) return;
    // The second takes the place of the first, which is let go: then one waits.
    const sensor_msgs::ImageConstPtr first = view();
    publisher_.publish(first);
    publisher_.publish(sensor_msgs::ImageConstPtr(view()));
    EXPECT_TRUE(waitUntil([&] { return first.use_count() == 1; }));
  });
  Tap pictures([&] { note('o'); });
  Reports reports("/diagnostics");
  const ros::Subscriber statistics = data.subscribe<MatchStatistics>(kMatcher + "statistics");
  const ros::Subscriber overlay =
      pictures.subscribe<sensor_msgs::Image>(kMatcher + "matches_image");
  load();
  ASSERT_TRUE(waitUntil(
      [&] { return overlay.getNumPublishers() > 0 && statistics.getNumPublishers() > 0; }));
  publisher_.publish(sensor_msgs::ImageConstPtr(view()));
  EXPECT_TRUE(waitUntil([&] { return contains("sss"); }));
  EXPECT_TRUE(waitUntil([&] { return contains("ssso"); })) << "one a second is drawn all the same";
  EXPECT_TRUE(waitUntil([&] { return diagnosticValue(reports, "overlays skipped") > "0"; }));
  behind = false;
  EXPECT_LE(order.size(), 2000U) << "none is skipped, or none is drawn";
}

TEST_F(Stream, OpencvKeepsTheThreadsOfTheOtherNodelets) {
  cv::setNumThreads(3);
  load();
  send(view());
  ASSERT_TRUE(test::Change().set("threads", 2).send("/camera/matcher"));
  send(view());
  EXPECT_EQ(cv::getNumThreads(), 3);
}

// Two matchers of one camera, one with threads of its own.
TEST_F(Stream, TwoMatchersWithDifferentThreadsGiveTheSame) {
  ros::param::set("/other/matcher/threads", 3);
  Recorder<Match> one(kMatcher + "match");
  Recorder<Match> three("/other/matcher/match");
  load();
  ASSERT_TRUE(loader_.load("/other/matcher", "ktgp_orb/matcher",
                           {{"/other/image", "/camera/image_raw"}}, {}));
  // Until both receive images: for ROS they are one subscriber.
  ASSERT_TRUE(waitUntil([&] {
    send(view());
    return !three.messages().empty();
  }));
  std::map<std::uint64_t, std::uint64_t> b_of_a, a_of_b;
  for (int i = 0; i < 5; ++i) {
    const ros::Time stamp = send(view()).header.stamp;
    ASSERT_TRUE(one.waitFor(stamp) && three.waitFor(stamp));
    Match a = *one.withStamp(stamp);
    Match b = *three.withStamp(stamp);
    // The number of a track depends on the frame in which the matcher began, so the tracks are
    // compared one to one.
    ASSERT_EQ(a.correspondences.track.size(), b.correspondences.track.size());
    for (std::size_t k = 0; k < a.correspondences.track.size(); ++k) {
      const auto track_a = a.correspondences.track[k];
      const auto track_b = b.correspondences.track[k];
      EXPECT_EQ(b_of_a.emplace(track_a, track_b).first->second, track_b);
      EXPECT_EQ(a_of_b.emplace(track_b, track_a).first->second, track_a);
    }
    a.correspondences.track.clear();
    b.correspondences.track.clear();
    ASSERT_EQ(a.statistics.status, MatchStatus::STATUS_OK);
    ASSERT_EQ(a.homography.reference_stamp, b.homography.reference_stamp);
    EXPECT_GT(a.correspondences.level.size(), 100U);
    EXPECT_EQ(a.correspondences, b.correspondences);
    EXPECT_EQ(a.homography, b.homography);
  }
  ros::param::del("/other");
}

TEST(StreamTransport, ReadOnceAtTheStart) {
  nodelet::Loader loader(false);
  ASSERT_TRUE(test::loadMatcher(loader, "/camera"));
  ros::param::set(kMatcher + "image_transport", "not_installed");
  {
    test::Camera camera("/camera/image_raw", {320, 240}, 30.0);
    camera.start();
    Recorder<MatchStatistics> statistics(kMatcher + "statistics");
    EXPECT_TRUE(statistics.waitForMore(2));
  }
  ros::param::del(kMatcher + "image_transport");
}

}  // namespace
}  // namespace ktgp_orb
