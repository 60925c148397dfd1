// The queues between callbacks and worker: an inbox that drops the oldest, a slot for the newest,
// and the count of lost messages. No ROS master is needed.

#include <gtest/gtest.h>

#include <boost/make_shared.hpp>
#include <thread>

#include "nodelet/frame_inbox.h"
#include "nodelet/image_store.h"
#include "nodelet/newest_slot.h"
#include "nodelet/sequence_numbers.h"

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

HomographyStampedConstPtr homography(int number) {
  auto message = boost::make_shared<HomographyStamped>();
  message->header.stamp = second(number);
  return message;
}

TEST(FrameInbox, ALateWorkerLosesTheOldestImagesAlone) {
  FrameInbox inbox;
  for (int i = 1; i <= 10; ++i) EXPECT_EQ(inbox.put(image(i)), 0U) << i;
  EXPECT_EQ(inbox.put(image(11)), 1U);
  for (int i = 1; i <= 301; ++i) inbox.put(homography(i));
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
  const auto content = inbox.take();  // the first call must not deliver it again
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

TEST(ImageStore, KeepsTheNewestOfANumberOfImages) {
  ImageStore store(3);
  for (int i = 1; i <= 5; ++i) EXPECT_EQ(store.put(image(i, 10)), 0U);
  EXPECT_EQ(store.size(), 3U);
  EXPECT_EQ(store.bytes(), 30U);
  EXPECT_FALSE(store.has(second(2)));
  EXPECT_EQ(store.take(second(4))->header.stamp, second(4));
  EXPECT_EQ(store.take(second(4)), nullptr);
  EXPECT_EQ(store.bytes(), 20U);
  store.setMost(1);
  EXPECT_EQ(store.put(image(6, 10)), 0U);
  EXPECT_EQ(store.size(), 1U);
}

TEST(ImageStore, KeepsTheNewestOfANumberOfBytesAndCountsTheOthers) {
  ImageStore store(40);
  store.setMostBytes(100);
  std::size_t gone = 0;
  for (int i = 1; i <= 40; ++i) {
    gone += store.put(image(i, 30));
    EXPECT_LE(store.bytes(), 100U);
  }
  EXPECT_EQ(gone, 37U);
  EXPECT_TRUE(store.has(second(40)));
  EXPECT_EQ(store.put(image(50, 1000)), 3U) << "the newest stays whatever it takes";
  EXPECT_EQ(store.bytes(), 1000U);
  store.clear();
  EXPECT_EQ(store.bytes(), 0U);
  EXPECT_EQ(store.put(image(51, 30)), 0U);
}

TEST(ImageStore, OfTwoImagesWithOneStampKeepsTheNewer) {
  ImageStore store(5);
  store.put(image(1, 10));
  store.put(image(1, 20));
  EXPECT_EQ(store.size(), 1U);
  EXPECT_EQ(store.bytes(), 20U);
}

TEST(FrameInbox, IsBoundedInBytes) {
  FrameInbox inbox;
  inbox.setMostBytes(100);
  std::size_t gone = 0;
  for (int i = 1; i <= 10; ++i) gone += inbox.put(image(i, 30));
  EXPECT_EQ(gone, 7U);
  const auto content = inbox.take();
  ASSERT_EQ(content->images.size(), 3U);
  EXPECT_EQ(content->images.back()->header.stamp, second(10));
  EXPECT_EQ(inbox.put(image(11, 30)), 0U) << "what was taken counts no more";
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
