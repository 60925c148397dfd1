// How what arrives reaches a worker: queues that lose the oldest, a slot for the newest, and the
// count of what was lost on the way. No ROS master is needed.

#include <gtest/gtest.h>

#include <boost/make_shared.hpp>
#include <thread>

#include "nodelet/frame_inbox.h"
#include "nodelet/newest_slot.h"
#include "nodelet/sequence_numbers.h"

namespace ktgp_orb {
namespace {

ros::Time second(int number) {
  return ros::Time(static_cast<std::uint32_t>(number), 0);
}

sensor_msgs::ImageConstPtr image(int number) {
  auto message = boost::make_shared<sensor_msgs::Image>();
  message->header.stamp = second(number);
  return message;
}

HomographyStampedConstPtr homography(int number) {
  auto message = boost::make_shared<HomographyStamped>();
  message->header.stamp = second(number);
  return message;
}

TEST(FrameInbox, ALateWorkerLosesTheOldestImagesAlone) {
  FrameInbox inbox;
  for (int i = 1; i <= 10; ++i) EXPECT_FALSE(inbox.put(image(i))) << i;
  EXPECT_TRUE(inbox.put(image(11)));
  for (int i = 1; i <= 300; ++i) EXPECT_FALSE(inbox.put(homography(i))) << i;
  EXPECT_TRUE(inbox.put(homography(301)));
  const auto content = inbox.take();
  ASSERT_TRUE(content);
  ASSERT_EQ(content->images.size(), 10U);
  EXPECT_EQ(content->images.front()->header.stamp, second(2));
  EXPECT_EQ(content->images.back()->header.stamp, second(11));
  ASSERT_EQ(content->homographies.size(), 300U);
  EXPECT_EQ(content->homographies.front()->header.stamp, second(2));
}

TEST(FrameInbox, WakingGivesNothingOnceAndThenItWaitsAgain) {
  FrameInbox inbox;
  inbox.wake();
  const auto woken = inbox.take();
  ASSERT_TRUE(woken);
  EXPECT_TRUE(woken->images.empty());
  std::thread later([&inbox] { inbox.put(image(1)); });
  const auto content = inbox.take();  // not again because of the same call
  later.join();
  ASSERT_TRUE(content);
  EXPECT_EQ(content->images.size(), 1U);
}

TEST(FrameInbox, WhatIsClearedIsNotTakenAndAClosedOneGivesNothing) {
  FrameInbox inbox;
  inbox.put(image(1));
  inbox.clear();
  inbox.put(image(2));
  const auto content = inbox.take();
  ASSERT_TRUE(content);
  ASSERT_EQ(content->images.size(), 1U);
  EXPECT_EQ(content->images.front()->header.stamp, second(2));
  inbox.put(image(3));
  inbox.close();
  EXPECT_FALSE(inbox.take());
}

TEST(ByStamp, KeepsSoManyOfTheNewestAndSaysHowManyHadToGo) {
  ByStamp<int> values(3);
  for (int i = 1; i <= 3; ++i) EXPECT_EQ(values.put(second(i), i), 0U);
  EXPECT_EQ(values.size(), 3U);
  EXPECT_EQ(values.take(second(2)), 2);
  EXPECT_FALSE(values.take(second(2)));
  EXPECT_EQ(values.put(second(4), 4), 1U);  // for 1
  EXPECT_EQ(values.put(second(5), 5), 0U);  // for 2, which was taken
  EXPECT_EQ(values.find(second(1)), nullptr);
  ASSERT_NE(values.find(second(3)), nullptr);
  EXPECT_EQ(*values.find(second(3)), 3);
  values.setMost(1);
  EXPECT_EQ(values.put(second(6), 6), 3U);
  EXPECT_EQ(values.size(), 1U);
}

TEST(NewestSlot, ANewValueReplacesTheOneThatWaits) {
  NewestSlot<int> slot;
  EXPECT_FALSE(slot.waiting());
  EXPECT_FALSE(slot.put(1));
  EXPECT_TRUE(slot.waiting());
  EXPECT_TRUE(slot.put(2));
  EXPECT_EQ(slot.take(), 2);
  EXPECT_FALSE(slot.waiting());
  EXPECT_FALSE(slot.put(3));
  slot.clear();
  EXPECT_FALSE(slot.waiting());
  EXPECT_FALSE(slot.put(4)) << "what was cleared is not replaced";
  slot.close();
  EXPECT_FALSE(slot.take());
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
