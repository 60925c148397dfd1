// Damaged bags: no crash, no memory for data that does not exist, and no frame lost without a
// message.
#include <gtest/gtest.h>
#include <rosbag/bag.h>
#include <std_msgs/String.h>
#include <sys/resource.h>
#include <tf2_msgs/TFMessage.h>
#include <unistd.h>

#include <cstdlib>
#include <fstream>
#include <map>
#include <string>
#include <vector>

#include "bag/reader.h"
#include "bag_damage.h"

namespace ktgp_orb {
namespace {

constexpr int kFrames = 8;
constexpr char kTopic[] = "/camera/image_raw";

/// KTGP_ORB_DAMAGES is the number of damages per compression; more for a long run.
std::uint64_t damages() {
  const char* text = std::getenv("KTGP_ORB_DAMAGES");
  return text == nullptr ? 572 : std::strtoull(text, nullptr, 10);
}

sensor_msgs::Image frame(int number) {
  sensor_msgs::Image image;
  image.header.stamp = ros::Time(100, static_cast<std::uint32_t>(number) * 10000000U);
  image.header.frame_id = "camera";
  image.encoding = "mono8";
  image.width = 40;
  image.height = 30;
  image.step = 40;
  image.data.resize(std::size_t{image.step} * image.height);
  std::mt19937 random(static_cast<unsigned>(number));
  for (auto& pixel : image.data) pixel = static_cast<std::uint8_t>(random() % 64);
  return image;
}

std::string temporaryFile() {
  return testing::TempDir() + "hostile_bag_" + std::to_string(getpid()) + ".bag";
}

test::FileBytes bytesOf(const std::string& path) {
  std::ifstream in(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), std::istreambuf_iterator<char>()};
}

void write(const std::string& path, const test::FileBytes& bytes) {
  std::ofstream(path, std::ios::binary | std::ios::trunc)
      .write(reinterpret_cast<const char*>(bytes.data()),
             static_cast<std::streamsize>(bytes.size()));
}

/// Eight images and as many strings in chunks of about two images.
test::FileBytes soundBag(rosbag::CompressionType compression) {
  const std::string path = temporaryFile();
  {
    rosbag::Bag bag(path, rosbag::bagmode::Write);
    bag.setCompression(compression);
    bag.setChunkThreshold(2000);
    for (int i = 0; i < kFrames; ++i) {
      const sensor_msgs::Image image = frame(i);
      std_msgs::String words;
      words.data = "frame " + std::to_string(i);
      bag.write(kTopic, image.header.stamp, image);
      bag.write("/words", image.header.stamp + ros::Duration(0.001), words);
    }
  }
  return bytesOf(path);
}

struct Reading {
  std::vector<sensor_msgs::ImageConstPtr> images;
  std::string damage;
  bool refused = false;  ///< UnusableBag: the program ends with an error
};

Reading read(const std::string& path) {
  Reading reading;
  try {
    const auto source = openBag(path, {kTopic, 0.0, -1.0});
    while (const auto image = source->next()) reading.images.push_back(image->image);
    reading.damage = source->damage();
  } catch (const UnusableBag& error) {
    reading.refused = true;
    reading.damage = error.what();
  }
  return reading;
}

std::size_t asRecorded(const Reading& reading) {
  std::size_t count = 0;
  for (const auto& image : reading.images) {
    const bool known = image->header.stamp.sec == 100;
    const int number = known ? static_cast<int>(image->header.stamp.nsec / 10000000U) : kFrames;
    if (number < kFrames && image->data == frame(number).data) ++count;
  }
  return count;
}

class HostileBag : public testing::TestWithParam<rosbag::CompressionType> {
 protected:
  void TearDown() override { std::remove(temporaryFile().c_str()); }
};

TEST_P(HostileBag, ASoundOneIsReadToTheEndAndNotComplainedAbout) {
  write(temporaryFile(), soundBag(GetParam()));
  const Reading reading = read(temporaryFile());
  EXPECT_EQ(asRecorded(reading), std::size_t{kFrames});
  EXPECT_EQ(reading.damage, "");
}

TEST_P(HostileBag, NoDamageCrashesOrLosesAFrameWithoutAWord) {
  const test::BagDamage damage(soundBag(GetParam()));
  std::size_t complete = 0, partly = 0, refused = 0, frames = 0;
  for (std::uint64_t n = 0; n < damages() && !HasFailure(); ++n) {
    std::string what = "damage " + std::to_string(n) + ": ";
    write(temporaryFile(), damage.make(n, what));
    const Reading reading = read(temporaryFile());
    frames += reading.images.size();
    // A pixel or a stamp may have changed: there is no checksum. But no frame may be missing, and a
    // part that occurs twice must not add frames.
    if (reading.images.size() != kFrames) {
      EXPECT_NE(reading.damage, "") << what << reading.images.size() << " frames";
    }
    ++(reading.refused ? refused : reading.images.size() < kFrames ? partly : complete);
  }
  std::printf(
      "%zu damaged bags: %zu with all frames, %zu with fewer, %zu of no use; %.1f %% of all "
      "frames read\n",
      static_cast<std::size_t>(damages()), complete, partly, refused,
      100.0 * static_cast<double>(frames) / static_cast<double>(damages() * kFrames));
}

INSTANTIATE_TEST_SUITE_P(Compressions, HostileBag,
                         testing::Values(rosbag::compression::Uncompressed,
                                         rosbag::compression::BZ2, rosbag::compression::LZ4));

TEST(HostileBag, OneDamagedChunkCostsItsOwnFramesAlone) {
  const test::FileBytes sound = soundBag(rosbag::compression::BZ2);
  const std::string header = "compression=bz2";
  auto place = std::search(sound.begin(), sound.end(), header.begin(), header.end());
  place = std::search(place + 1, sound.end(), header.begin(), header.end());
  test::FileBytes damaged = sound;
  damaged[static_cast<std::size_t>(place - sound.begin()) + 200] ^= 0x10;
  write(temporaryFile(), damaged);
  const Reading reading = read(temporaryFile());
  EXPECT_EQ(asRecorded(reading), reading.images.size());
  EXPECT_EQ(reading.images.size(), std::size_t{kFrames - 2});
  EXPECT_EQ(reading.damage.rfind("2 images lost; a chunk cannot be decompressed", 0), 0U)
      << reading.damage;
  std::remove(temporaryFile().c_str());
}

TEST(HostileBag, AnImageThatClaimsFourGigabytesTakesNone) {
  test::FileBytes bytes = soundBag(rosbag::compression::Uncompressed);
  const std::uint32_t size = 40 * 30;
  const auto* wanted = reinterpret_cast<const std::uint8_t*>(&size);
  const auto place = std::search(bytes.begin(), bytes.end(), wanted, wanted + 4);
  ASSERT_NE(place, bytes.end());
  std::fill(place, place + 4, 0xff);
  write(temporaryFile(), bytes);
  rusage before{};
  getrusage(RUSAGE_SELF, &before);
  const Reading reading = read(temporaryFile());
  rusage after{};
  getrusage(RUSAGE_SELF, &after);
  EXPECT_LT(after.ru_maxrss - before.ru_maxrss, 50000) << "kB";
  EXPECT_EQ(reading.images.size(), std::size_t{kFrames - 1});
  EXPECT_EQ(reading.damage.rfind("1 images lost", 0), 0U) << reading.damage;
  std::remove(temporaryFile().c_str());
}

TEST(HostileBag, TransformsThatClaimFourBillionTakeNoMemory) {
  tf2_msgs::TFMessage transforms;
  transforms.transforms.resize(3);
  transforms.transforms[2].child_frame_id = "camera";
  {
    rosbag::Bag bag(temporaryFile(), rosbag::bagmode::Write);
    bag.write("/tf", ros::Time(1), transforms);
    bag.write("/tf", ros::Time(2), transforms);
  }
  test::FileBytes bytes = bytesOf(temporaryFile());
  const std::vector<std::uint8_t> count{3, 0, 0, 0, 0, 0, 0, 0};  // and seq of the first header
  const auto place = std::search(bytes.begin(), bytes.end(), count.begin(), count.end());
  ASSERT_NE(place, bytes.end());
  std::fill(place, place + 4, 0xff);
  write(temporaryFile(), bytes);
  BagMessages messages(temporaryFile());
  messages.select([](const bag::Topic& topic) { return topic.name == "/tf"; });
  const auto damaged = messages.next();
  ASSERT_TRUE(damaged);
  EXPECT_EQ(damaged->as<tf2_msgs::TFMessage>(), nullptr);
  const auto sound = messages.next();
  ASSERT_TRUE(sound);
  EXPECT_EQ(sound->received, ros::Time(2));
  EXPECT_EQ(sound->as<std_msgs::String>(), nullptr) << "another type";
  ASSERT_NE(sound->as<tf2_msgs::TFMessage>(), nullptr);
  EXPECT_EQ(sound->as<tf2_msgs::TFMessage>()->transforms[2].child_frame_id, "camera");
  EXPECT_FALSE(messages.next());
  std::remove(temporaryFile().c_str());
}

}  // namespace
}  // namespace ktgp_orb
