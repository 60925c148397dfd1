// Panoramas: the mosaic of a camera that only turns, against the sphere that is drawn around it.
#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "frame_pair.h"
#include "ktgp_orb/mosaic.h"
#include "mosaic/surface.h"
#include "mosaic/turn.h"
#include "turning_camera.h"

namespace ktgp_orb {
namespace {

using mosaic::Surface;
using mosaic::Turn;

constexpr double kDegree = M_PI / 180.0;
constexpr std::int64_t kPeriod = 100'000'000;  // ns

Eigen::Matrix3d about(const Eigen::Vector3d& axis, double degrees) {
  return Eigen::AngleAxisd(degrees * kDegree, axis.normalized()).toRotationMatrix();
}

/// The camera after a pan to the right.
Eigen::Matrix3d panned(double degrees) {
  return about(Eigen::Vector3d::UnitY(), -degrees);
}

/// What became of a recording.
struct Outcome {
  int lost = 0;
  double mean = 0.0;     // error of the corners in a panorama, px
  double largest = 0.0;  // of a frame's mean
  std::optional<Panorama> panorama;
  std::size_t maps = 0;
  cv::Size size;
  LostBecause because = LostBecause::nothing;
  std::string why;
  bool has_parallax = false;
};

/// Images of a camera, and the homographies that a matcher finds.
class Recording {
 public:
  explicit Recording(const std::optional<Eigen::Matrix3d>& camera = std::nullopt) {
    mosaic.setCamera(camera);
  }

  /// `turn`: world -> camera.
  void go(const Eigen::Matrix3d& turn, const Eigen::Vector3d& position = Eigen::Vector3d::Zero()) {
    show(world.view(turn, position), turn);
  }

  void show(const cv::Mat& image, const Eigen::Matrix3d& turn = Eigen::Matrix3d::Identity()) {
    Features features = test::featuresOf(image);
    std::optional<Eigen::Matrix3d> h;
    if (stamp_ > 0) {
      MatchResult result;
      matcher_.match(before_, features, {}, result);
      if (result.homographyStatus() == Status::ok) h = result.answer.homography;
    }
    before_ = std::move(features);
    stamp_ += kPeriod;
    mosaic.follow(stamp_, stamp_ - kPeriod, h);
    if (mosaic.place(stamp_, image) == Placement::lost) {
      ++outcome_.lost;
      outcome_.because = mosaic.lostBecause();
      outcome_.why = mosaic.whyLost();
    } else {
      placed_.emplace_back(turn, *mosaic.pose());
    }
  }

  Outcome outcome() {
    outcome_.panorama = mosaic.panorama();
    outcome_.maps = mosaic.maps();
    outcome_.size = mosaic.area().size();
    outcome_.has_parallax = mosaic.hasParallax();
    if (outcome_.panorama) compare();
    return outcome_;
  }

  test::TurningCamera world;
  Mosaic mosaic;

 private:
  /// The frames in the map, and where they would be with the true camera and turns.
  void compare() {
    const Surface found(outcome_.panorama->camera, outcome_.panorama->axis);
    const Eigen::Matrix3d first = placed_.front().first;
    const Surface truth(world.camera, outcome_.panorama->axis);
    for (const auto& [turn, pose] : placed_) {
      double sum = 0.0;
      for (const Eigen::Vector2d& corner : {Eigen::Vector2d(0, 0), Eigen::Vector2d(319, 0),
                                            Eigen::Vector2d(0, 239), Eigen::Vector2d(319, 239)}) {
        const Eigen::Vector2d right =
            truth.toMap(world.homography(first * turn.transpose()) * corner.homogeneous());
        const Eigen::Vector2d here = found.toMap(pose.inverse() * corner.homogeneous());
        sum += 0.25 * (found.near(here, right) - right).norm();
      }
      outcome_.mean += sum / static_cast<double>(placed_.size());
      outcome_.largest = std::max(outcome_.largest, sum);
    }
  }

  KtgpMatcher matcher_{MatcherOptions::robust()};
  Features before_;
  std::int64_t stamp_ = 0;
  std::vector<std::pair<Eigen::Matrix3d, Eigen::Matrix3d>> placed_;
  Outcome outcome_;
};

Eigen::Matrix3d cameraOf(double factor) {
  Eigen::Matrix3d camera = test::TurningCamera().camera;
  camera.diagonal().head<2>() *= factor;
  return camera;
}

void print(const char* name, double degrees, const Outcome& o) {
  std::printf(
      "%s, %.0f degrees: %.2f px off (largest %.2f), %d lost, %dx%d px, f %.1f, closed %.1f\n",
      name, degrees, o.mean, o.largest, o.lost, o.size.width, o.size.height,
      o.panorama ? o.panorama->camera(0, 0) : 0.0, o.panorama ? o.panorama->closed_off : 0.0);
}

Outcome pan(double degrees, const std::optional<Eigen::Matrix3d>& camera,
            const Eigen::Matrix3d& mount = Eigen::Matrix3d::Identity()) {
  Recording recording(camera);
  for (double angle = 0.0; angle <= degrees; angle += 3.0) {
    recording.go(mount * panned(angle) * mount.transpose());
  }
  return recording.outcome();
}

TEST(Panorama, FollowsACameraThatPans) {
  for (const double degrees : {60.0, 120.0, 360.0}) {
    for (const bool is_known : {true, false}) {
      const Outcome o = pan(degrees, is_known ? std::make_optional(cameraOf(1.0)) : std::nullopt);
      print(is_known ? "K known" : "K not known", degrees, o);
      ASSERT_TRUE(o.panorama);
      EXPECT_EQ(o.panorama->is_estimated, !is_known);
      EXPECT_NEAR(o.panorama->camera(0, 0), 280.0, 1.5);
      EXPECT_EQ(o.lost, 0);
      EXPECT_EQ(o.maps, 1U);
      EXPECT_LT(o.largest, degrees < 360.0 ? 0.5 : 3.0);
      // A full turn ends where it began.
      EXPECT_NEAR(o.panorama->degrees, std::min(360.0, degrees + 60.0), 1.0);
      EXPECT_NEAR(o.size.width, 280.0 * kDegree * o.panorama->degrees, 10.0);
      EXPECT_EQ(o.panorama->closed_off > 0.0, degrees == 360.0);
      EXPECT_LT(o.panorama->closed_off, 4.0);
    }
  }
}

TEST(Panorama, GoesOnIntoASecondTurn) {
  const Outcome o = pan(450.0, cameraOf(1.0));
  ASSERT_TRUE(o.panorama);
  EXPECT_EQ(o.lost, 0);
  EXPECT_LE(o.size.width, 2.0 * M_PI * 280.0);
  EXPECT_LT(o.largest, 2.5);
}

TEST(Panorama, HomographiesCorrectAFocalLengthThatIsALittleWrong) {
  for (const double factor : {0.97, 1.03}) {
    const Outcome o = pan(360.0, cameraOf(factor));
    print(factor < 1.0 ? "3 % short" : "3 % long", 360.0, o);
    ASSERT_TRUE(o.panorama);
    EXPECT_TRUE(o.panorama->is_estimated);
    EXPECT_NEAR(o.panorama->camera(0, 0), 280.0, 1.5);
    EXPECT_EQ(o.lost, 0);
    EXPECT_LT(o.largest, 4.0);
  }
}

TEST(Panorama, ARolledOrTiltedCameraGivesAStraightStrip) {
  for (const auto& [name, mount] :
       {std::pair("rolled", about({0, 0, 1}, 25.0)), std::pair("tilted", about({1, 0, 0}, 20.0)),
        std::pair("both", Eigen::Matrix3d(about({1, 0, 0}, -15.0) * about({0, 0, 1}, -20.0)))}) {
    const Outcome o = pan(180.0, cameraOf(1.0), mount);
    print(name, 180.0, o);
    ASSERT_TRUE(o.panorama);
    const Eigen::Vector3d axis = mount * Eigen::Vector3d::UnitY();
    EXPECT_LT(std::acos(std::abs(o.panorama->axis.dot(axis))) / kDegree, 0.1) << name;
    EXPECT_EQ(o.lost, 0);
    EXPECT_LT(o.largest, 0.5);
  }
}

/// A pan by hand, at the end of an arm: a share of the distance, which varies by a fifth.
Outcome handHeld(double arm, const std::optional<Eigen::Matrix3d>& camera) {
  Recording recording(camera);
  recording.world.relief = 0.2;
  for (int i = 0; i <= 40; ++i) {
    const double angle = 3.0 * i * kDegree;
    const Eigen::Matrix3d shake =
        about({std::sin(1.3 * i), std::cos(2.1 * i), std::sin(0.7 * i)}, 1.0);
    recording.go(shake * panned(3.0 * i),
                 arm * Eigen::Vector3d(std::sin(angle), 0.0, std::cos(angle) - 1.0));
  }
  return recording.outcome();
}

TEST(Panorama, BearsAHandAndSaysWhereThingsAreTooNear) {
  for (const bool is_known : {true, false}) {
    const auto camera = is_known ? std::make_optional(cameraOf(1.0)) : std::nullopt;
    const Outcome far = handHeld(0.01, camera);
    print("hand-held, 1 %", 120.0, far);
    ASSERT_TRUE(far.panorama);
    EXPECT_EQ(far.lost, 0);
    EXPECT_FALSE(far.has_parallax);
    EXPECT_LT(far.largest, 12.0);
    const Outcome near = handHeld(0.1, camera);
    print("hand-held, 10 %", 120.0, near);
    std::printf("  lost because %d: %s\n", static_cast<int>(near.because), near.why.c_str());
    EXPECT_TRUE(near.has_parallax) << near.lost;
  }
}

/// Poses of a camera that moves over a plane at the distance 1 with the normal `normal`: after each
/// step it has turned and moved once more; px of noise at four points.
std::vector<Eigen::Matrix3d> flight(const Eigen::Vector3d& step, const Eigen::Matrix3d& turn,
                                    const Eigen::Vector3d& normal, double noise, int frames,
                                    std::uint64_t seed) {
  const test::TurningCamera world;
  test::Numbers numbers(seed);
  std::vector<Eigen::Matrix3d> poses;
  Eigen::Matrix3d turned = Eigen::Matrix3d::Identity();
  for (int i = 1; i <= frames; ++i) {
    turned = turn * turned;
    const Eigen::Matrix3d moved =
        turned * (Eigen::Matrix3d::Identity() - i * step * normal.normalized().transpose());
    Eigen::Matrix3d shaken = Eigen::Matrix3d::Identity();
    for (int k = 0; k < 8; ++k) {
      const double size = k == 2 || k == 5 ? 1.0 : k >= 6 ? 1.0 / (280.0 * 280.0) : 1.0 / 280.0;
      shaken(k / 3, k % 3) += noise * size * numbers.normal();
    }
    poses.emplace_back(shaken * world.homography(moved));
  }
  return poses;
}

TEST(Panorama, TurnsAreToldFromFlights) {
  const cv::Size size = test::TurningCamera().size;
  const Eigen::Vector3d ahead = Eigen::Vector3d::UnitZ(), still = Eigen::Vector3d::Zero();
  const Eigen::Matrix3d level = Eigen::Matrix3d::Identity();
  int wrong = 0, missed = 0;
  for (std::uint64_t seed = 0; seed < 20; ++seed) {
    test::Numbers numbers(seed);
    const auto any = [&] { return numbers.uniform(-1.0, 1.0); };
    // Over a quarter of the picture, 0.29 of the distance, in ten frames.
    const Eigen::Vector3d step = 0.029 * Eigen::Vector3d(any(), any(), 0.5 * any()).normalized();
    const Eigen::Vector3d tilted(any(), any(), 1.5);
    const Eigen::Matrix3d turn = about({any(), any(), any()}, 3.0);
    for (const bool is_known : {true, false}) {
      const auto camera = is_known ? std::make_optional(cameraOf(1.0)) : std::nullopt;
      const auto turns = [&](const std::vector<Eigen::Matrix3d>& poses) {
        return mosaic::testTurn(poses, size, camera).verdict == Turn::Verdict::turns;
      };
      wrong += turns(flight(step, level, ahead, 0.3, 10, seed)) ? 1 : 0;
      wrong += turns(flight(step, level, tilted, 0.3, 10, seed)) ? 1 : 0;
      wrong += turns(flight(step, turn, ahead, 0.3, 10, seed)) ? 1 : 0;
      wrong += turns(flight(step, turn, tilted, 0.3, 10, seed)) ? 1 : 0;
      const Eigen::Matrix3d aside = about({any(), 2.0, 0.2 * any()}, 3.0);
      missed += turns(flight(still, aside, ahead, 0.3, 10, seed)) ? 0 : 1;
    }
  }
  EXPECT_EQ(wrong, 0) << "of 160 flights";
  EXPECT_EQ(missed, 0) << "of 40 turns";
}

TEST(Panorama, FlightsOverFlatGroundStayPlanes) {
  const cv::Mat ground = test::textureImage({1400, 1000}, 3);
  for (const double tilt : {0.0, 1.5}) {  // degrees a frame
    Recording recording(cameraOf(1.0));
    for (int i = 0; i <= 30; ++i) {
      Eigen::Matrix3d plane = about({1, 0, 0}, tilt * i);
      plane.col(2) << -0.06 * i, 0.0, 1.0;
      const Eigen::Matrix3d view =
          recording.world.camera * plane * cameraOf(1.0).inverse() * test::translation(-500, -380);
      recording.show(test::warped(ground, view / view(2, 2), {320, 240}, cv::INTER_LINEAR));
    }
    const Outcome o = recording.outcome();
    EXPECT_FALSE(o.panorama);
    if (tilt > 0.0 && o.lost > 0) std::printf("%d lost: %s\n", o.lost, o.why.c_str());
  }
}

}  // namespace
}  // namespace ktgp_orb
