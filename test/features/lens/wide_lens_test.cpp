// Lenses of 120 to 200 degrees, by drawn views of a room, of a plane, and of a camera that only
// turns: homographies of rectified points, and motions by preset slam. Each is right, or there is
// none. It prints the rows of doc/measurements/wide_lenses.md.

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <Eigen/QR>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <functional>
#include <memory>
#include <opencv2/imgproc.hpp>
#include <utility>
#include <vector>

#include "ktgp_orb/sequence_matcher.h"
#include "orb_test_images.h"
#include "synthetic_pairs.h"

namespace ktgp_orb {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector2d;
using Eigen::Vector3d;

constexpr int kSide = 600;  // px, of the images
constexpr int kTrials = 8;
constexpr double kMiddle = 0.5 * (kSide - 1);

double radians(double degrees) {
  return degrees * M_PI / 180.0;
}
double degrees(double radians) {
  return radians * 180.0 / M_PI;
}

/// World -> camera: x -> turn (x - place). The first camera is at the origin and looks along z.
struct Pose {
  Matrix3d turn = Matrix3d::Identity();
  Vector3d place = Vector3d::Zero();
};

/// Grey value that a ray from a place meets.
using World = std::function<double(const Vector3d& place, const Vector3d& ray)>;

/// The value at (x, y) in units of `scale` px from the middle of a picture; grey outside.
double valueAt(const cv::Mat& picture, double x, double y, double scale) {
  const double u = 0.5 * picture.cols + scale * x, v = 0.5 * picture.rows + scale * y;
  const int column = static_cast<int>(std::floor(u)), row = static_cast<int>(std::floor(v));
  if (column < 0 || row < 0 || column + 1 >= picture.cols || row + 1 >= picture.rows) return 128.0;
  const double a = u - column, b = v - row;
  const auto* const above = picture.ptr<std::uint8_t>(row) + column;
  const auto* const below = picture.ptr<std::uint8_t>(row + 1) + column;
  return (1 - b) * ((1 - a) * above[0] + a * above[1]) + b * ((1 - a) * below[0] + a * below[1]);
}

/// A room of two units in each direction, with the first camera in its middle.
World room(std::uint64_t seed) {
  std::array<cv::Mat, 6> walls;
  for (std::size_t i = 0; i < walls.size(); ++i) {
    walls[i] = test::blockImage({640, 640}, 10 * seed + i, 150);
    cv::GaussianBlur(walls[i], walls[i], {}, 1.2);
  }
  return [walls](const Vector3d& place, const Vector3d& ray) {
    const Eigen::Array3d way =
        (ray.array().sign() - place.array()) / ray.array().abs().max(1e-9) * ray.array().sign();
    Eigen::Index axis = 0;
    const Vector3d at = place + way.minCoeff(&axis) * ray;
    const auto wall = static_cast<std::size_t>(2 * axis + (ray[axis] > 0.0 ? 1 : 0));
    return valueAt(walls[wall], at[(axis + 1) % 3], at[(axis + 2) % 3], 319.0);
  };
}

/// The plane z = 1.
World plane(std::uint64_t seed) {
  cv::Mat picture = test::blockImage({2400, 2400}, seed, 150);
  cv::GaussianBlur(picture, picture, {}, 1.2);
  return [picture](const Vector3d& place, const Vector3d& ray) {
    if (ray.z() < 0.02) return 128.0;
    const Vector3d at = place + (1.0 - place.z()) / ray.z() * ray;
    return valueAt(picture, at.x(), at.y(), 300.0);
  };
}

/// Focal length of an equidistant lens that shows so many degrees, px.
double focalLength(double field) {
  return 0.5 * kSide / radians(0.5 * field);
}

cv::Mat view(const World& world, const Pose& pose, double field, std::uint64_t seed) {
  test::Numbers noise(seed);
  return test::drawn({kSide, kSide}, [&](int x, int y) {
    const Vector2d from_axis = Vector2d(x - kMiddle, y - kMiddle) / focalLength(field);
    const double angle = from_axis.norm();
    if (angle > radians(0.5 * field)) return 0.0;
    Vector3d ray;
    ray << from_axis * (std::sin(angle) / std::max(angle, 1e-12)), std::cos(angle);
    return world(pose.place, pose.turn.transpose() * ray) + 2.0 * noise.normal();
  });
}

/// Coefficients k1 k2 p1 p2 k3 k4 k5 k6 of the radial-tangential model that map rays like an
/// equidistant lens, fitted up to 65 degrees from the axis: with x = tan(angle),
/// x (1 + k1 x^2 + k2 x^4 + k3 x^6) = angle (1 + k4 x^2 + k5 x^4 + k6 x^6).
std::vector<double> rationalCoefficients() {
  constexpr int kAngles = 65;
  Eigen::MatrixXd a(kAngles, 6);
  Eigen::VectorXd b(kAngles);
  for (int i = 0; i < kAngles; ++i) {
    const double angle = radians(i + 1), x = std::tan(angle);
    for (int power = 0; power < 3; ++power) {
      const double even = std::pow(x, 2 * power + 2);
      a(i, power) = x * even;
      a(i, power + 3) = -angle * even;
    }
    b[i] = angle - x;
  }
  const Eigen::VectorXd k = a.colPivHouseholderQr().solve(b);
  return {k[0], k[1], 0.0, 0.0, k[2], k[3], k[4], k[5]};
}

struct WideCamera {
  WideCamera(double field, LensModel model) {
    const double f = focalLength(field);
    LensCalibration c;
    c.model = model;
    c.image_size = {kSide, kSide};
    c.camera = {f, 0.0, kMiddle, 0.0, f, kMiddle, 0.0, 0.0, 1.0};
    c.distortion =
        model == LensModel::equidistant ? std::vector<double>(4, 0.0) : rationalCoefficients();
    c.rectified_camera = c.camera;
    lens = std::make_shared<const Lens>(c);
    k = test::cameraMatrix(f, f, kMiddle, kMiddle);
  }
  LensConstPtr lens;
  Matrix3d k;
};

/// The match of the second image to the first one.
SequenceMatch matched(const WideCamera& camera, const std::array<cv::Mat, 2>& images,
                      const MatcherOptions& options, bool rectify) {
  SequenceOptions sequence;
  sequence.matcher = options;
  sequence.orb.max_features = 3000;
  SequenceMatcher matcher(sequence);
  for (std::size_t i = 0; i < images.size(); ++i) {
    const FramePtr frame = matcher.newFrame();
    frame->stamp = static_cast<std::int64_t>(1 + i) * 100'000'000;
    frame->image = images[i];
    frame->lens = rectify ? camera.lens : nullptr;
    frame->camera = camera.k;
    frame->camera_lens = rectify ? nullptr : camera.lens;
    if (i > 0) return matcher.match(frame);
    matcher.match(frame);
  }
  return {};
}

/// Results of one kind for a lens.
struct Tally {
  int found = 0;
  int wrong = 0;
  double worst = 0.0;

  void add(double error, double limit) {
    ++found;
    wrong += error < limit ? 0 : 1;
    worst = std::max(worst, error);
  }
};

/// px, within 45 degrees of the axis; `truth`: from the pixels of the first image.
double errorOf(const Matrix3d& h, const Matrix3d& truth, const Matrix3d& k) {
  double worst = 0.0;
  for (int i = 0; i < 8; ++i) {
    const Vector3d ray(std::cos(i * M_PI / 4.0), std::sin(i * M_PI / 4.0), 1.0);
    const Vector2d at = (k * ray).hnormalized();
    worst = std::max(worst, (test::apply(h, at) - test::apply(truth, at)).norm());
  }
  return worst;
}

double angleBetween(const Vector3d& a, const Vector3d& b) {
  return degrees(std::atan2(a.cross(b).norm(), a.dot(b)));
}

/// A turn by `angle` degrees and a step of the given length, in directions that differ by trial.
Pose moved(test::Numbers& numbers, double angle, double step) {
  const auto direction = [&] {
    return Vector3d(numbers.normal(), numbers.normal(), numbers.normal()).normalized();
  };
  return {Eigen::AngleAxisd(radians(angle), direction()).toRotationMatrix(), step * direction()};
}

/// Results of all trials with a lens.
struct Row {
  Tally turn[2], plane[2];  // homographies: ktgp, robust; px
  Tally rotation;           // by slam, of a camera that only turns, degrees
  Tally motion;             // by slam, in the room: the direction, degrees
};

void addHomographies(const WideCamera& camera, const std::array<cv::Mat, 2>& images,
                     const Matrix3d& truth, Tally (&tallies)[2]) {
  constexpr double kWrong = 2.0;  // px
  const MatcherOptions presets[] = {MatcherOptions::ktgp(), MatcherOptions::robust()};
  for (std::size_t i = 0; i < 2; ++i) {
    const SequenceMatch match = matched(camera, images, presets[i], true);
    if (match.match.homographyStatus() != Status::ok) continue;
    tallies[i].add(errorOf(match.match.answer.homography, truth, camera.k), kWrong);
  }
}

void addMotion(const WideCamera& camera, const std::array<cv::Mat, 2>& images, const Pose& pose,
               Tally& tally) {
  constexpr double kWrongTurn = 0.5, kWrongDirection = 5.0;  // degrees
  const SequenceMatch match = matched(camera, images, MatcherOptions::slam(), false);
  const TwoView& found = match.match.two_view.view;
  if (match.match.status != Status::ok || found.other) return;
  const Matrix3d off = found.pose.rotation * pose.turn.transpose();
  const double turn = degrees(Eigen::AngleAxisd(off).angle());
  if (pose.place.isZero()) {
    tally.add(found.geometry == Geometry::rotation ? turn : 180.0, kWrongTurn);
    return;
  }
  const Vector3d truth = -(pose.turn * pose.place);
  const double direction = turn < kWrongTurn ? angleBetween(found.pose.translation, truth) : 180.0;
  tally.add(direction, kWrongDirection);
}

Row rowOf(double field, LensModel model) {
  const WideCamera camera(field, model);
  const Matrix3d back = camera.k.inverse();
  Row row;
  for (int trial = 0; trial < kTrials; ++trial) {
    const auto seed = static_cast<std::uint64_t>(100 * trial + 1);
    test::Numbers numbers(seed);
    const auto images = [&](const World& world, const Pose& pose) {
      return std::array<cv::Mat, 2>{view(world, {}, field, seed + 1),
                                    view(world, pose, field, seed + 2)};
    };
    Pose pose = moved(numbers, 3.0, 0.0);
    auto pair = images(room(seed), pose);
    addHomographies(camera, pair, camera.k * pose.turn * back, row.turn);
    addMotion(camera, pair, pose, row.rotation);
    pose = moved(numbers, 3.0, 0.1);
    addMotion(camera, images(room(seed), pose), pose, row.motion);
    pair = images(plane(seed), pose);
    const Matrix3d by_plane =
        pose.turn * (Matrix3d::Identity() - pose.place * Vector3d::UnitZ().transpose());
    addHomographies(camera, pair, camera.k * by_plane * back, row.plane);
  }
  return row;
}

TEST(WideLens, HomographiesAndMotionsAreRightOrThereIsNone) {
  const auto equidistant = LensModel::equidistant, rational = LensModel::radial_tangential;
  for (const auto& [field, model] : {std::pair{120.0, equidistant},
                                     {140.0, equidistant},
                                     {160.0, equidistant},
                                     {180.0, equidistant},
                                     {200.0, equidistant},
                                     {120.0, rational},
                                     {140.0, rational}}) {
    const Row row = rowOf(field, model);
    std::printf("| %.0f°%s |", field, model == rational ? ", rational" : "");
    for (const Tally& tally : {row.turn[0], row.turn[1], row.plane[0], row.plane[1]}) {
      std::printf(" %d, %.2f px |", tally.found, tally.worst);
      EXPECT_EQ(tally.wrong, 0) << field;
      EXPECT_GE(tally.found, kTrials - 1) << field;
    }
    for (const Tally& tally : {row.rotation, row.motion}) {
      std::printf(" %d, %.2f° |", tally.found, tally.worst);
      EXPECT_EQ(tally.wrong, 0) << field;
      EXPECT_GE(tally.found, kTrials - 1) << field;
    }
    std::printf("\n");
  }
}

}  // namespace
}  // namespace ktgp_orb
