// Damaged bags: no crash, no memory for data that does not exist, and no frame lost without a
// message.
#include <gtest/gtest.h>
#include <rosbag/bag.h>
#include <std_msgs/String.h>
#include <sys/resource.h>
#include <tf2_msgs/TFMessage.h>
#include <unistd.h>

#include <algorithm>
#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include "bag/reader.h"

namespace ktgp_orb {
namespace {

using FileBytes = std::vector<std::uint8_t>;

/// Damages the bytes of an intact bag in many ways. Damage number `n` is always the same, so the
/// number is enough to see one again.
class BagDamage {
 public:
  explicit BagDamage(FileBytes sound) : sound_(std::move(sound)) { findRecords(); }

  FileBytes make(std::uint64_t n) const {
    std::mt19937_64 random(n);
    FileBytes bytes = sound_;
    // First a cut at every boundary of records, then random kinds.
    if (n < boundaries_.size()) return cut(bytes, boundaries_[n]);
    using Kind = void (BagDamage::*)(FileBytes&, std::mt19937_64&) const;
    constexpr Kind kKinds[] = {&BagDamage::flipAnywhere,  &BagDamage::flipInHeader,
                               &BagDamage::flipInHeader,  &BagDamage::falsifyLength,
                               &BagDamage::falsifyLength, &BagDamage::cutAnywhere,
                               &BagDamage::swapRecords,   &BagDamage::overwrite,
                               &BagDamage::removePart,    &BagDamage::repeatPart};
    const auto kind = kKinds[random() % std::size(kKinds)];
    (this->*kind)(bytes, random);
    if (random() % 8 == 0) flipInHeader(bytes, random);  // a second one
    return bytes;
  }

 private:
  struct Record {
    std::size_t begin;  ///< the length of the header
    std::size_t data;   ///< the length of the data precedes it
    std::size_t end;
    bool chunk;
  };

  std::uint32_t numberAt(std::size_t i) const {
    std::uint32_t number = 0;
    std::memcpy(&number, &sound_[i], 4);
    return number;
  }

  void findRecords() {
    addRecords(13, sound_.size());
    boundaries_.push_back(0);
    for (const Record& record : records_) {
      for (const std::size_t place : {record.begin, record.begin + 4, record.data, record.end}) {
        boundaries_.push_back(place);
        if (place > 0) boundaries_.push_back(place - 1);
      }
    }
    std::sort(boundaries_.begin(), boundaries_.end());
    boundaries_.erase(std::unique(boundaries_.begin(), boundaries_.end()), boundaries_.end());
    boundaries_.pop_back();  // the whole file
  }

  /// Including those within uncompressed chunks.
  void addRecords(std::size_t begin, std::size_t end) {
    while (begin + 8 <= end) {
      const std::size_t data = begin + 8 + numberAt(begin);
      if (data > end) return;
      Record record{begin, data, data + numberAt(data - 4), false};
      const std::string header(&sound_[begin], &sound_[data]);
      record.chunk = header.find("compression=") != std::string::npos;
      records_.push_back(record);
      if (header.find("compression=none") != std::string::npos) addRecords(data, record.end);
      begin = record.end;
    }
  }

  static FileBytes cut(FileBytes bytes, std::size_t size) {
    bytes.resize(size);
    return bytes;
  }

  const Record& anyRecord(std::mt19937_64& random) const {
    return records_[random() % records_.size()];
  }

  static void flip(FileBytes& bytes, std::size_t byte, std::mt19937_64& random) {
    if (byte >= bytes.size()) return;
    const unsigned bit = random() % 8;
    bytes[byte] = static_cast<std::uint8_t>(bytes[byte] ^ 1U << bit);
  }

  void flipAnywhere(FileBytes& bytes, std::mt19937_64& random) const {
    flip(bytes, random() % bytes.size(), random);
  }

  void flipInHeader(FileBytes& bytes, std::mt19937_64& random) const {
    const Record& record = anyRecord(random);
    flip(bytes, record.begin + random() % (record.data - record.begin), random);
  }

  /// Replaces a length or another number by a critical value.
  void falsifyLength(FileBytes& bytes, std::mt19937_64& random) const {
    const Record& record = anyRecord(random);
    const std::size_t places[] = {record.begin, record.data - 4, record.begin + 4,
                                  record.begin + random() % (record.data - record.begin),
                                  record.data + random() % 64};
    const std::size_t place = places[random() % std::size(places)];
    if (place + 4 > bytes.size()) return;
    const std::uint32_t old = numberAt(place);
    const std::uint32_t values[] = {0,       1,       old + 1,     old - 1,     old * 2,
                                    old / 2, old + 4, 0x7fffffffU, 0xffffffffU, 0x40000000U};
    const std::uint32_t value = values[random() % std::size(values)];
    std::memcpy(&bytes[place], &value, 4);
  }

  void cutAnywhere(FileBytes& bytes, std::mt19937_64& random) const {
    bytes = cut(bytes, random() % bytes.size());
  }

  void swapRecords(FileBytes& bytes, std::mt19937_64& random) const {
    const bool chunks = random() % 2 == 0;
    std::vector<Record> those;
    for (const Record& record : records_) {
      if (!chunks || record.chunk) those.push_back(record);
    }
    Record a = those[random() % those.size()];
    Record b = those[random() % those.size()];
    if (b.begin < a.begin) std::swap(a, b);
    if (a.end > b.begin) return;  // the same record, or one within the other
    const auto at = [&](std::size_t i) { return sound_.begin() + static_cast<std::ptrdiff_t>(i); };
    bytes.assign(at(0), at(a.begin));
    bytes.insert(bytes.end(), at(b.begin), at(b.end));
    bytes.insert(bytes.end(), at(a.end), at(b.begin));
    bytes.insert(bytes.end(), at(a.begin), at(a.end));
    bytes.insert(bytes.end(), at(b.end), sound_.end());
  }

  static std::pair<std::size_t, std::size_t> part(const FileBytes& bytes, std::mt19937_64& random) {
    const std::size_t begin = random() % bytes.size();
    const std::size_t size = std::size_t{1} << random() % 14;
    return {begin, std::min(size, bytes.size() - begin)};
  }

  void overwrite(FileBytes& bytes, std::mt19937_64& random) const {
    const auto [begin, size] = part(bytes, random);
    const bool zero = random() % 2 == 0;
    for (std::size_t i = begin; i < begin + size; ++i) {
      bytes[i] = zero ? 0 : static_cast<std::uint8_t>(random());
    }
  }

  void removePart(FileBytes& bytes, std::mt19937_64& random) const {
    const auto [begin, size] = part(bytes, random);
    const auto at = bytes.begin() + static_cast<std::ptrdiff_t>(begin);
    bytes.erase(at, at + static_cast<std::ptrdiff_t>(size));
  }

  void repeatPart(FileBytes& bytes, std::mt19937_64& random) const {
    const auto [begin, size] = part(bytes, random);
    const auto at = bytes.begin() + static_cast<std::ptrdiff_t>(begin);
    const FileBytes copy(at, at + static_cast<std::ptrdiff_t>(size));
    bytes.insert(bytes.begin() + static_cast<std::ptrdiff_t>(begin), copy.begin(), copy.end());
  }

  FileBytes sound_;
  std::vector<Record> records_;
  std::vector<std::size_t> boundaries_;
};

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

FileBytes bytesOf(const std::string& path) {
  std::ifstream in(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), std::istreambuf_iterator<char>()};
}

void write(const std::string& path, const FileBytes& bytes) {
  std::ofstream(path, std::ios::binary | std::ios::trunc)
      .write(reinterpret_cast<const char*>(bytes.data()),
             static_cast<std::streamsize>(bytes.size()));
}

/// Eight images and as many strings in chunks of about two images.
FileBytes soundBag(rosbag::CompressionType compression) {
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

/// The bytes as a file.
Reading read(const FileBytes& bytes) {
  const std::string path = temporaryFile();
  write(path, bytes);
  Reading reading;
  try {
    const auto source = openBag(path, {kTopic, 0.0, -1.0});
    while (const auto image = source->next()) reading.images.push_back(image->image);
    reading.damage = source->damage();
  } catch (const UnusableBag& error) {
    reading.refused = true;
    reading.damage = error.what();
  }
  std::remove(path.c_str());
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

class HostileBag : public testing::TestWithParam<rosbag::CompressionType> {};

TEST_P(HostileBag, IntactBagIsReadWithoutComplaint) {
  const Reading reading = read(soundBag(GetParam()));
  EXPECT_EQ(asRecorded(reading), std::size_t{kFrames});
  EXPECT_EQ(reading.damage, "");
}

TEST_P(HostileBag, NoDamageCrashesOrLosesAFrameWithoutAWord) {
  const BagDamage damage(soundBag(GetParam()));
  std::size_t complete = 0, partly = 0, refused = 0, frames = 0;
  for (std::uint64_t n = 0; n < damages() && !HasFailure(); ++n) {
    const Reading reading = read(damage.make(n));
    frames += reading.images.size();
    // A pixel or a stamp may have changed: there is no checksum. But no frame may be missing, and a
    // part that occurs twice must not add frames.
    if (reading.images.size() != kFrames) {
      EXPECT_NE(reading.damage, "") << "damage " << n << ": " << reading.images.size() << " frames";
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

TEST(HostileBag, DamagedChunkCostsOnlyItsFrames) {
  const FileBytes sound = soundBag(rosbag::compression::BZ2);
  const std::string header = "compression=bz2";
  auto place = std::search(sound.begin(), sound.end(), header.begin(), header.end());
  place = std::search(place + 1, sound.end(), header.begin(), header.end());
  FileBytes damaged = sound;
  damaged[static_cast<std::size_t>(place - sound.begin()) + 200] ^= 0x10;
  const Reading reading = read(damaged);
  EXPECT_EQ(asRecorded(reading), reading.images.size());
  EXPECT_EQ(reading.images.size(), std::size_t{kFrames - 2});
  EXPECT_EQ(reading.damage.rfind("2 images lost; a chunk cannot be decompressed", 0), 0U)
      << reading.damage;
}

TEST(HostileBag, ImageClaimingFourGigabytesAllocatesNone) {
  FileBytes bytes = soundBag(rosbag::compression::Uncompressed);
  const std::uint32_t size = 40 * 30;
  const auto* wanted = reinterpret_cast<const std::uint8_t*>(&size);
  const auto place = std::search(bytes.begin(), bytes.end(), wanted, wanted + 4);
  ASSERT_NE(place, bytes.end());
  std::fill(place, place + 4, 0xff);
  rusage before{};
  getrusage(RUSAGE_SELF, &before);
  const Reading reading = read(bytes);
  rusage after{};
  getrusage(RUSAGE_SELF, &after);
  EXPECT_LT(after.ru_maxrss - before.ru_maxrss, 50000) << "kB";
  EXPECT_EQ(reading.images.size(), std::size_t{kFrames - 1});
  EXPECT_EQ(reading.damage.rfind("1 of the images lost; ", 0), 0U) << reading.damage;
}

/// SECURITY.md: 1 GiB. The data are damaged, too, so nothing is written to that memory.
TEST(HostileBag, ChunkThatClaimsMoreThanAGibibyteIsNotDecompressed) {
  FileBytes bytes = soundBag(rosbag::compression::BZ2);
  const auto find = [&](const std::string& text, auto from) {
    return std::search(from, bytes.end(), text.begin(), text.end());
  };
  const auto compression = find("compression=bz2", bytes.begin());
  ASSERT_NE(compression, bytes.end());
  const std::string field = "size=";
  const auto size = find(field, compression - 40);  // in the same header
  ASSERT_LT(size - compression, 100);
  *(compression + 200) ^= 0x10;
  for (const std::uint32_t claimed : {1U << 30U, (1U << 30U) + 1U}) {
    std::memcpy(&*size + field.size(), &claimed, sizeof claimed);
    const Reading reading = read(bytes);
    EXPECT_EQ(reading.images.size(), std::size_t{kFrames - 1});
    const std::string refused = "bytes claim to be " + std::to_string(claimed);
    EXPECT_EQ(reading.damage.find(refused) != std::string::npos, claimed > 1U << 30U)
        << reading.damage;
  }
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
  FileBytes bytes = bytesOf(temporaryFile());
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
