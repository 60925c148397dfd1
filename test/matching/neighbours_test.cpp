// Matches that near matches confirm, in drawn frames with known right matches.

#include "matching/neighbours.h"

#include <gtest/gtest.h>

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "frame_pair.h"
#include "synthetic_pairs.h"

namespace ktgp_orb {
namespace {

constexpr std::size_t kRight = 200;
constexpr std::size_t kWrong = 400;

/// The target is the reference, turned by `angle`; the first kRight matches are right.
struct Frames {
  Features reference, target;
  std::vector<Correspondence> matches;

  Frames(const cv::Size& size, double angle) {
    test::Numbers numbers(1);
    const std::vector<std::uint8_t> descriptor(kDescriptorBytes, 0);
    const Eigen::Vector2d middle(0.5 * size.width, 0.5 * size.height);
    reference.image_size = target.image_size = size;
    for (std::size_t i = 0; i < kRight + kWrong; ++i) {
      const bool is_right = i < kRight;
      const Eigen::Vector2d from = numbers.pointIn(size);
      const double direction = numbers.uniform(0.0, 2.0 * M_PI);
      const double turn = is_right ? angle : numbers.uniform(0.0, 2.0 * M_PI);
      const Eigen::Vector2d to =
          is_right ? Eigen::Vector2d(middle +
                                     Eigen::Rotation2Dd(angle).toRotationMatrix() * (from - middle))
                   : numbers.pointIn(size);
      test::addKeypoint(from, direction, 31.0, descriptor, reference);
      test::addKeypoint(to, direction + turn, 31.0, descriptor, target);
      const auto index = static_cast<std::int32_t>(i);
      matches.push_back({index, index, 10, 20, Level::ktg});
    }
  }

  std::size_t kept(std::size_t begin, std::size_t end) const {
    std::size_t count = 0;
    for (std::size_t i = begin; i < end; ++i) count += matches[i].level == Level::ktg ? 1 : 0;
    return count;
  }
};

TEST(Neighbours, KeepTheRightMatchesOfTurnedAndOfLargeImages) {
  for (const cv::Size& size : {cv::Size(640, 480), cv::Size(4000, 3000)}) {
    for (const double angle : {0.0, 1.0, M_PI}) {
      Frames frames(size, angle);
      const std::size_t dropped =
          matching::Neighbours().drop(frames.reference, frames.target, frames.matches);
      const std::size_t right = frames.kept(0, kRight);
      const std::size_t wrong = frames.kept(kRight, kRight + kWrong);
      EXPECT_GE(right, kRight * 5 / 6) << size << angle;
      EXPECT_LE(wrong, kWrong / 20) << size << angle;
      EXPECT_EQ(dropped, kRight + kWrong - right - wrong);
    }
  }
}

/// A match needs two others, also after a call with many matches.
TEST(Neighbours, DropOneOrTwoMatchesAlone) {
  matching::Neighbours neighbours;
  for (const std::size_t count :
       {kRight + kWrong, std::size_t{2}, std::size_t{1}, std::size_t{0}}) {
    Frames frames({640, 480}, 0.0);
    frames.matches.resize(count);
    const std::size_t dropped = neighbours.drop(frames.reference, frames.target, frames.matches);
    if (count > 2) continue;
    EXPECT_EQ(dropped, count);
  }
}

TEST(Neighbours, LeaveMatchesOfOtherLevelsAlone) {
  Frames frames({640, 480}, 0.0);
  for (Correspondence& c : frames.matches) c.level = Level::knn;
  EXPECT_EQ(matching::Neighbours().drop(frames.reference, frames.target, frames.matches), 0U);
  for (const Correspondence& c : frames.matches) EXPECT_EQ(c.level, Level::knn);
}

}  // namespace
}  // namespace ktgp_orb
