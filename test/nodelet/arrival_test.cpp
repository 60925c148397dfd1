// The way from callbacks to a worker: an inbox that drops the oldest, the worker's jobs, and the
// count of lost messages. No ROS master is needed.

#include <gtest/gtest.h>

#include <boost/make_shared.hpp>
#include <memory>
#include <stdexcept>
#include <string>
#include <thread>
#include <vector>

#include "nodelet/image_store.h"
#include "nodelet/input.h"
#include "nodelet/worker.h"
#include "ros/image_stamps.h"

namespace ktgp_orb {
namespace {

ros::Time second(int number) {
  return ros::Time(static_cast<std::uint32_t>(number), 0);
}

sensor_msgs::ImageConstPtr image(int number, std::size_t bytes = 0) {
  auto message = boost::make_shared<sensor_msgs::Image>();
  message->header.stamp = second(number);
  message->data.resize(bytes);
  return message;
}

constexpr std::size_t kData = 1;
constexpr std::size_t kOther = 2;

std::vector<int> taken(Inbox<int>& inbox) {
  std::vector<int> items;
  EXPECT_TRUE(inbox.take(items));
  return items;
}

TEST(Inbox, KeepsOrderAndDropsOldestOfAKind) {
  Inbox<int> inbox;
  inbox.setLimits(kData, 2, 1000);
  inbox.put(0, 0, 100);
  EXPECT_EQ(inbox.put(kData, 0, 1), 0U);
  EXPECT_EQ(inbox.put(kData, 0, 2), 0U);
  for (int i = 0; i < 50; ++i) EXPECT_EQ(inbox.put(kOther, 0, 200 + i), 0U) << "without a limit";
  EXPECT_EQ(inbox.put(kData, 0, 3), 1U);
  const std::vector<int> items = taken(inbox);
  ASSERT_EQ(items.size(), 53U);
  EXPECT_EQ(items[0], 100);
  EXPECT_EQ(items[1], 2);
  EXPECT_EQ(items[2], 200);
  EXPECT_EQ(items.back(), 3);
  EXPECT_FALSE(inbox.has(kData)) << "what was taken does not wait";
  EXPECT_EQ(inbox.put(kData, 0, 4), 0U);
}

TEST(Inbox, IsBoundedInBytesButTheNewestStays) {
  Inbox<int> inbox;
  inbox.setLimits(kData, 100, 100);
  std::size_t gone = 0;
  for (int i = 1; i <= 10; ++i) gone += inbox.put(kData, 30, i);
  EXPECT_EQ(gone, 7U);
  EXPECT_EQ(inbox.put(kData, 1000, 11), 3U);
  EXPECT_EQ(taken(inbox), std::vector<int>{11});
  EXPECT_EQ(inbox.put(kData, 30, 12), 0U) << "what was taken counts no more";
}

TEST(Inbox, ClearedItemsAreNotTakenAndClosedInboxIsEmpty) {
  Inbox<int> inbox;
  inbox.put(kData, 0, 1);
  inbox.put(kOther, 0, 2);
  EXPECT_TRUE(inbox.has(kData));
  inbox.clear(kData);
  EXPECT_FALSE(inbox.has(kData));
  EXPECT_EQ(taken(inbox), std::vector<int>{2});
  std::thread later([&inbox] { inbox.put(kData, 0, 3); });
  EXPECT_EQ(taken(inbox), std::vector<int>{3}) << "it waits";
  later.join();
  inbox.put(kData, 0, 4);
  inbox.close();
  std::vector<int> items;
  EXPECT_FALSE(inbox.take(items));
  EXPECT_EQ(inbox.put(kData, 0, 5), 0U);
}

/// Jobs of a worker, in order.
struct Notes {
  std::vector<int> numbers;
  void add(const boost::shared_ptr<const int>& number) { numbers.push_back(*number); }
};

TEST(Worker, DoesJobsInTheirOrderAndGoesOnAfterOneThatThrows) {
  Worker<Notes> worker;
  std::string failed;
  worker.put<&Notes::add>(kData, 0, boost::make_shared<const int>(1));  // before the start
  worker.start(std::make_unique<Notes>(),
               [&](const std::exception& error) { failed = error.what(); });
  worker.post([](Notes&) { throw std::runtime_error("lost"); });
  worker.put<&Notes::add>(kData, 0, boost::make_shared<const int>(2));
  EXPECT_EQ(worker.ask([](Notes& notes) { return notes.numbers; }), (std::vector<int>{1, 2}));
  EXPECT_EQ(failed, "lost");
  EXPECT_THROW(worker.ask([](Notes&) { throw std::invalid_argument("no"); }),
               std::invalid_argument);
  worker.stop();
  EXPECT_THROW(worker.ask([](Notes& notes) { return notes.numbers; }), std::future_error);
}

TEST(ImageStore, KeepsTheNewestOfANumberOfImages) {
  ImageStore store;
  for (int i = 1; i <= 42; ++i) EXPECT_EQ(store.put(image(i, 10)), 0U);
  EXPECT_EQ(store.size(), 40U);
  EXPECT_EQ(store.bytes(), 400U);
  EXPECT_FALSE(store.has(second(2)));
  EXPECT_EQ(store.take(second(4))->header.stamp, second(4));
  EXPECT_EQ(store.take(second(4)), nullptr);
  EXPECT_EQ(store.bytes(), 390U);
  store.clear();
  store.setLag(2);
  for (int i = 1; i <= 50; ++i) EXPECT_EQ(store.put(image(i, 10)), 0U);
  EXPECT_EQ(store.size(), 42U);
}

TEST(ImageStore, KeepsTheNewestOfANumberOfBytesAndCountsTheOthers) {
  ImageStore store;
  std::size_t gone = 0;
  for (int i = 1; i <= 10; ++i) gone += store.put(image(i, 36000000));
  EXPECT_EQ(gone, 3U);
  EXPECT_EQ(store.bytes(), 7U * 36000000U);
  EXPECT_TRUE(store.has(second(10)));
  EXPECT_EQ(store.put(image(11, 256000000)), 4U) << "four stay whatever they take";
  store.setLag(2);
  EXPECT_EQ(store.put(image(12, 10)), 0U) << "and those of a lag";
  EXPECT_EQ(store.put(image(13, 10)), 0U);
  EXPECT_EQ(store.put(image(14, 10)), 1U);
  EXPECT_EQ(store.size(), 6U);
  store.clear();
  EXPECT_EQ(store.bytes(), 0U);
  EXPECT_EQ(store.put(image(15, 30)), 0U);
}

// Every second image repeats the one before, so it never gets a homography.
TEST(ImageStore, ImagesThatWerePassedAreNotCounted) {
  ImageStore store;
  std::size_t gone = 0;
  for (int i = 1; i <= 60; ++i) {
    gone += store.put(image(i, 25000000));
    if (i > 4 && i % 2 == 1) {
      EXPECT_NE(store.take(second(i - 4)), nullptr) << i;
    }
  }
  EXPECT_EQ(gone, 0U);
  EXPECT_LE(store.bytes(), ImageStore::kBytes);
}

TEST(ImageStore, GivesImagesWithOneStampInTheirOrder) {
  ImageStore store;
  store.put(image(1, 10));
  store.put(image(1, 20));
  EXPECT_EQ(store.size(), 2U);
  EXPECT_EQ(store.take(second(1))->data.size(), 10U);
  EXPECT_EQ(store.take(second(1))->data.size(), 20U);
  EXPECT_FALSE(store.has(second(1)));
  EXPECT_EQ(store.bytes(), 0U);
}

using Wrong = ImageStamps::Wrong;

TEST(ImageStamps, SaysWhichStampIsWrong) {
  ImageStamps stamps;
  const ros::Time unknown;
  EXPECT_EQ(stamps.wrongWith(second(0), unknown), Wrong::zero);
  EXPECT_EQ(stamps.wrongWith(second(5), unknown), Wrong::nothing);
  EXPECT_EQ(stamps.wrongWith(second(5), unknown), Wrong::again);
  EXPECT_EQ(stamps.wrongWith(second(4), unknown), Wrong::back);
  EXPECT_EQ(stamps.wrongWith(second(6), unknown), Wrong::nothing);
  EXPECT_EQ(stamps.wrong(), second(4));
  for (const int ahead : {100, 8, 9, 10}) stamps.wrongWith(second(ahead), unknown);
  EXPECT_EQ(stamps.wrong(), second(100)) << "those after it go on from those before it";
}

TEST(ImageStamps, OneAheadOfItsTimeIsKnownByItsArrival) {
  for (const double ahead : {0.5, 3600.0}) {
    ImageStamps stamps;
    for (int i = 0; i < 60; ++i) {
      const double delay = i == 30 ? 0.08 : 0.02;  // s, of a computer that was busy once
      const bool is_wrong = i == 3 || i == 20 || i == 45;
      const double arrival = 1000.0 + i / 30.0 + delay;
      const double stamp = 1000.0 + i / 30.0 + (is_wrong ? ahead : 0.0);
      EXPECT_EQ(stamps.wrongWith(ros::Time(stamp), ros::Time(arrival)),
                is_wrong ? Wrong::ahead : Wrong::nothing)
          << i << ", " << ahead;
      if (is_wrong) {
        EXPECT_NEAR(stamps.wrong().toSec(), stamp, 1e-6);
      }
    }
  }
}

TEST(ImageStamps, AnyStampIsComparedWithAnyOther) {
  ImageStamps stamps;
  for (const double stamp : {1.8e9, 1e-9, 4294967295.0, 1.8e9, 4294967295.0, 1e-9}) {
    for (const double arrival : {1.8e9, 1e-9, 4294967295.0}) {
      EXPECT_NO_THROW(stamps.wrongWith(ros::Time(stamp), ros::Time(arrival))) << stamp;
    }
  }
}

TEST(ImageStamps, StampsThatGoBackWithTheClockAreRight) {
  ImageStamps stamps;
  for (int i = 0; i < 90; ++i) {  // a recording of one second, played three times with --clock
    const ros::Time stamp(1000.0 + (i % 30) / 30.0);
    EXPECT_EQ(stamps.wrongWith(stamp, stamp + ros::Duration(0.02)), Wrong::nothing) << i;
  }
  // The clock goes on, so this stamp is wrong.
  EXPECT_EQ(stamps.wrongWith(ros::Time(1000.2), ros::Time(1001.02)), Wrong::back);
}

TEST(ImageStamps, AClockThatWasSetCostsOneImage) {
  ImageStamps stamps;
  int refused = 0;
  for (int i = 0; i < 60; ++i) {
    const ros::Time arrival(1000.0 + i / 30.0);
    const ros::Time stamp(arrival.toSec() + (i < 30 ? 0.0 : 2.0));
    refused += stamps.wrongWith(stamp, arrival) == Wrong::nothing ? 0 : 1;
  }
  EXPECT_EQ(refused, 1);
}

TEST(ImageStamps, StampsThatOnlyComeFasterOrLateAreRight) {
  ImageStamps stamps;
  const double delays[] = {0.02, 0.02, 0.02, 0.5, 0.47, 0.02, 0.02, 0.3, 0.02};  // overload
  for (int i = 0; i < 90; ++i) {
    const double stamp = 1000.0 + i / 30.0;
    EXPECT_EQ(stamps.wrongWith(ros::Time(stamp), ros::Time(stamp + delays[i % 9])), Wrong::nothing)
        << i;
  }
  double start = 1200.0;
  for (const double rate : {30.0, 5.0}) {  // a full queue of five images, which is emptied at once
    start += 300.0;
    for (int i = 0; i < 90; ++i) {
      const double stamp = start + i / rate;
      const double delay = i % 45 < 30 ? 0.02 : 0.02 + 5.0 / rate;
      EXPECT_EQ(stamps.wrongWith(ros::Time(stamp), ros::Time(stamp + delay)), Wrong::nothing)
          << rate << ", " << i;
    }
  }
  ImageStamps fast;
  for (int i = 0; i < 90; ++i) {  // a recording that is played at four times its speed
    const double stamp = 2000.0 + i / 30.0;
    EXPECT_EQ(fast.wrongWith(ros::Time(stamp), ros::Time(2000.0 + i / 120.0)), Wrong::nothing) << i;
  }
}

TEST(SequenceNumbers, CountWhatIsBetweenUnlessTheCounterIsAnother) {
  SequenceNumbers numbers;
  EXPECT_EQ(numbers.lostBefore(70), 0U);
  EXPECT_EQ(numbers.lostBefore(71), 0U);
  EXPECT_EQ(numbers.lostBefore(73), 1U);
  EXPECT_EQ(numbers.lostBefore(73), 0U);
  EXPECT_EQ(numbers.lostBefore(5), 0U);
  EXPECT_EQ(numbers.lostBefore(1006), 1000U);
  EXPECT_EQ(numbers.lostBefore(2008), 0U) << "1001 are too many to be believed";
  numbers.restart();
  EXPECT_EQ(numbers.lostBefore(2010), 0U);
}

}  // namespace
}  // namespace ktgp_orb
