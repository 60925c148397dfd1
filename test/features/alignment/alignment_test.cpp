#include "ktgp_orb/alignment.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <opencv2/core.hpp>
#include <random>
#include <stdexcept>
#include <vector>

#include "alignment_scene.h"
#include "features/alignment/kernels.h"
#include "features/alignment/spread.h"
#include "homography/transform.h"
#include "instruction_sets.h"
#include "ktgp_orb/metrics.h"
#include "synthetic_pairs.h"

namespace ktgp_orb {
namespace {

using alignment::PointSpread;

using test::AlignmentScene;
using test::planeScene;
using test::translation;
using test::turn;

const cv::Size kSize(640, 480);

double cornerError(const AlignmentResult& result, const Eigen::Matrix3d& truth) {
  return metrics::cornerError(result.answer.homography, truth, kSize);
}

AlignmentResult align(const AlignmentScene& scene, const Eigen::Matrix3d& start,
                      const AlignmentOptions& options = {},
                      double max_error = ProsacOptions().max_error) {
  Alignment alignment(options, max_error);
  AlignmentResult result;
  alignment.align(scene.reference, scene.target, scene.matches, test::uncertain(start), result);
  return result;
}

double worstPoint(const AlignmentResult& result, const Eigen::Matrix3d& truth) {
  double worst = 0.0;
  for (const AlignedPoint& p : result.points) {
    worst = std::max(worst, reprojectionError(truth, p.reference, p.target));
  }
  return worst;
}

std::size_t dropped(const AlignmentResult& r) {
  return r.outside + r.distorted + r.textureless + r.unsettled + r.beyond_reach + r.uncorrelated;
}

Eigen::Matrix3d tilt() {
  Eigen::Matrix3d h = turn(8.0, 1.1);
  h.bottomLeftCorner<1, 2>() << 1e-4, -5e-5;
  return h;
}

/// By which the points lie beside the truth, px.
Eigen::Vector2d meanOffset(const AlignmentResult& result, const Eigen::Matrix3d& truth) {
  Eigen::Vector2d sum = Eigen::Vector2d::Zero();
  for (const AlignedPoint& p : result.points) sum += p.target - test::apply(truth, p.reference);
  return sum / static_cast<double>(result.points.size());
}

/// The scene whose reference shows `picture` and whose target shows `seen`.
AlignmentScene sceneOf(const test::WavePicture& picture,
                       const std::function<double(const Eigen::Vector2d&)>& seen,
                       const Eigen::Matrix3d& truth = Eigen::Matrix3d::Identity()) {
  const auto grey = [&](const Eigen::Vector2d& x) { return picture.at(x); };
  return {test::render(kSize, grey), test::render(kSize, seen), truth};
}

TEST(Alignment, RecoversTranslationsToAFiftiethOfAPixel) {
  for (const double shift : {0.0, 0.13, 0.5, 0.77, 3.31}) {
    const Eigen::Matrix3d truth = translation(shift, -2.0 * shift);
    const AlignmentScene scene = planeScene(1, truth);
    const AlignmentResult result = align(scene, translation(0.8, -0.6) * truth);
    ASSERT_EQ(result.status, AlignmentStatus::ok);
    EXPECT_GT(result.points.size(), 0.95 * static_cast<double>(result.tried));
    EXPECT_LT(worstPoint(result, truth), 0.03) << "shift " << shift;
    EXPECT_LT(cornerError(result, truth), 0.01) << "shift " << shift;
    EXPECT_NEAR(result.rmse_before, 1.0, 0.02);
    EXPECT_LT(result.rmse_after, 0.01);
  }
}

// Samples between pixels were cut to 1/256 px, and all patches displaced by half of that. An exact
// start, whose samples lie on pixels, does not show it.
TEST(Alignment, AnInexactStartDisplacesNothing) {
  const Eigen::Matrix3d truth = translation(2.0, -1.0);
  for (const unsigned seed : {1U, 2U, 3U}) {
    const AlignmentScene scene = planeScene(seed, truth);
    const AlignmentResult result = align(scene, truth * turn(0.05, 1.0005));
    ASSERT_EQ(result.status, AlignmentStatus::ok);
    EXPECT_LT(meanOffset(result, truth).cwiseAbs().maxCoeff(), 0.0006) << seed;
  }
}

// The sums are in single precision; the documented range is 0.5 to 1.
TEST(Alignment, NoCorrelationIsAboveOne) {
  const auto faint = [](double grey) { return 0.2 * grey + 180.0; };
  for (const auto& scene :
       {planeScene(5, translation(0.0, 0.0)), planeScene(5, translation(1.0, 2.0), faint)}) {
    const AlignmentResult result = align(scene, translation(0.0, 0.0));
    ASSERT_GT(result.points.size(), 100u);
    double highest = 0.0;
    for (const AlignedPoint& p : result.points) highest = std::max(highest, p.correlation);
    EXPECT_GT(highest, 0.98);
    EXPECT_LE(highest, 1.0);
  }
}

TEST(Alignment, RecoversTurnsZoomsAndTilts) {
  for (const Eigen::Matrix3d& truth :
       {turn(3.0, 1.02), turn(-30.0, 0.8), turn(170.0, 1.3), tilt()}) {
    const AlignmentScene scene = planeScene(2, truth);
    const AlignmentResult result = align(scene, translation(-0.7, 0.5) * truth);
    ASSERT_EQ(result.status, AlignmentStatus::ok);
    EXPECT_GT(result.points.size(), 100u);
    EXPECT_LT(cornerError(result, truth), 0.02) << truth;
  }
}

// The fit uses points within twice the threshold, which grows with the image: here a start is off
// by 1.5 px.
TEST(Alignment, LimitsScaleWithThresholdAndImage) {
  const Eigen::Matrix3d start = translation(1.5, 0.0);
  const auto status = [&](double max_error, const cv::Size& size) {
    const auto shade = [](double grey) { return grey; };
    return align(planeScene(2, translation(0.0, 0.0), shade, size), start, {}, max_error).status;
  };
  EXPECT_EQ(status(1.0, {640, 480}), AlignmentStatus::ok);
  EXPECT_EQ(status(0.5, {640, 480}), AlignmentStatus::not_better);
  EXPECT_EQ(status(2.0, {320, 240}), AlignmentStatus::ok);
  EXPECT_EQ(status(1.0, {320, 240}), AlignmentStatus::not_better);
}

// With perspective, the middle of a patch is not mapped to the middle of its image.
TEST(Alignment, PerspectiveWithinAPatchShiftsNothing) {
  const Eigen::Matrix3d truth = turn(0.0, 1.0, {6e-4, -4e-4});
  const AlignmentResult result = align(planeScene(2, truth / truth(2, 2)), truth / truth(2, 2));
  ASSERT_GT(result.points.size(), 100u);
  EXPECT_LT(meanOffset(result, truth).norm(), 0.004) << "px; without the correction 0.017";
}

TEST(Alignment, GainAndBiasMakeNoDifference) {
  const Eigen::Matrix3d truth = tilt();
  const auto shade = [](double grey) { return 0.6 * grey + 40.0; };
  const AlignmentResult result = align(planeScene(3, truth, shade), translation(0.5, 0.9) * truth);
  ASSERT_EQ(result.status, AlignmentStatus::ok);
  EXPECT_LT(result.rmse_after, 0.02);
  EXPECT_LT(cornerError(result, truth), 0.02);
}

TEST(Alignment, ComparesThePyramidLevelsWhoseScalesMatch) {
  for (const double zoom : {0.45, 2.2}) {
    const Eigen::Matrix3d truth = turn(10.0, zoom);
    const AlignmentResult result = align(planeScene(4, truth), translation(0.5, -0.5) * truth);
    ASSERT_EQ(result.status, AlignmentStatus::ok) << zoom;
    EXPECT_LT(cornerError(result, truth), 0.1) << zoom;
  }
}

TEST(Alignment, ThirdOfOutliersDoesNotMoveIt) {
  // The lower part of the target shows another picture.
  const Eigen::Matrix3d truth = translation(1.3, 0.4);
  const test::WavePicture picture(5);
  const test::WavePicture other(6);
  const auto seen = [&](const Eigen::Vector2d& x) {
    return x.y() < 320.0 ? picture.at(x - Eigen::Vector2d(1.3, 0.4)) : other.at(x);
  };
  const AlignmentResult result =
      align(sceneOf(picture, seen, truth), translation(0.3, 0.3) * truth);
  EXPECT_GT(dropped(result), result.tried / 5);
  ASSERT_EQ(result.status, AlignmentStatus::ok);
  EXPECT_LT(cornerError(result, truth), 0.3);
}

/// Moves the target's keypoints by up to `most` px along each axis, like the errors of detectors.
void disturb(double most, AlignmentScene& scene) {
  std::mt19937 random(5);
  std::uniform_real_distribution<float> shift(static_cast<float>(-most), static_cast<float>(most));
  for (cv::KeyPoint& keypoint : scene.target.keypoints) {
    keypoint.pt.x += shift(random);
    keypoint.pt.y += shift(random);
  }
}

// Every patch is exact, and two thirds of them lie on one plane within a hundredth of a pixel. The
// right homography is still the one that fits all.
TEST(Alignment, DoesNotLockOntoOneOfTwoPlanes) {
  const test::WavePicture picture(7);
  const auto seen = [&](const Eigen::Vector2d& x) {
    return picture.at(x - Eigen::Vector2d(static_cast<int>(x.x() / 64.0) % 3 == 0 ? 0.9 : 0.0, 0));
  };
  AlignmentScene scene = sceneOf(picture, seen);
  disturb(1.2, scene);
  const AlignmentResult result = align(scene, translation(0.2, 0.1));
  ASSERT_EQ(result.status, AlignmentStatus::ok);
  const double at_centre = test::apply(result.answer.homography, {320, 240}).x() - 320.0;
  EXPECT_GT(at_centre, 0.2);
  EXPECT_LT(at_centre, 0.45);
}

// A relief: every piece of the picture moved independently. The covariance says how little aligned
// points then determine the nearest plane.
TEST(Alignment, PatchworkHasLargeCovariance) {
  const test::WavePicture picture(8);
  std::mt19937 random(6);
  std::uniform_real_distribution<float> shift(-1.5F, 1.5F);
  Eigen::Vector2d moved[10][8];
  for (auto& column : moved) {
    for (Eigen::Vector2d& m : column) m = {shift(random), shift(random)};
  }
  const auto seen = [&](const Eigen::Vector2d& x) {
    const int column = static_cast<int>(x.x() / 64.0);
    return picture.at(x - moved[column][static_cast<int>(x.y() / 60.0)]);
  };
  const AlignmentResult relief = align(sceneOf(picture, seen), translation(0.2, 0.1));
  EXPECT_GT(relief.points.size(), 100u);
  for (const Eigen::Vector2d& corner : homography::imageCorners({640, 480}, {})) {
    const auto slope = homography::jacobianByEntries(relief.answer.homography, corner);
    const Eigen::Matrix2d spread = slope * relief.answer.covariance * slope.transpose();
    const Eigen::Vector2d error = test::apply(relief.answer.homography, corner) - corner;
    EXPECT_LT(error.dot(spread.inverse() * error), 13.8);
  }
}

TEST(Alignment, LeavesTheHomographyWhereNothingCanBeAligned) {
  const Eigen::Matrix3d truth = translation(2.0, 1.0);
  const Eigen::Matrix3d start = translation(0.5, 0.5) * truth;
  const AlignmentScene good = planeScene(8, truth);
  const cv::Mat flat(480, 640, CV_8U, cv::Scalar(90));
  const cv::Mat white(480, 640, CV_8U, cv::Scalar(255));
  const cv::Mat& picture = good.reference.images.front();

  const AlignmentResult textureless = align({flat, picture, truth}, start);
  EXPECT_EQ(textureless.textureless, textureless.tried);
  const AlignmentResult saturated = align({picture, white, truth}, start);
  EXPECT_EQ(saturated.uncorrelated, saturated.tried);
  const AlignmentResult outside = align(good, translation(-2000.0, 0.0));
  EXPECT_EQ(outside.outside, outside.tried);
  Eigen::Matrix3d squeezed = Eigen::Matrix3d::Identity();
  squeezed(0, 0) = 0.05;
  const AlignmentResult distorted = align(good, squeezed);
  EXPECT_EQ(distorted.distorted, distorted.tried);
  for (const AlignmentResult* r : {&textureless, &saturated, &outside, &distorted}) {
    EXPECT_EQ(r->status, AlignmentStatus::too_few_points);
    EXPECT_GT(r->tried, 100u);
    EXPECT_TRUE(r->points.empty());
    EXPECT_EQ(r->answer.covariance, test::keypointCovariance());
  }
  EXPECT_EQ(textureless.answer.homography, start);
  EXPECT_EQ(outside.answer.homography, translation(-2000.0, 0.0));
  EXPECT_EQ(distorted.answer.homography, squeezed);
}

TEST(Alignment, StripesDetermineNoShiftAlongThem) {
  const auto stripes = [](const Eigen::Vector2d& x) {
    return 128.0 + 60.0 * std::sin(x.x() / 2.0);
  };
  const cv::Mat image = test::render({640, 480}, stripes);
  const AlignmentResult result = align({image, image, translation(0, 0)}, translation(0.3, 2.0));
  EXPECT_EQ(result.textureless, result.tried);
  EXPECT_EQ(result.answer.homography, translation(0.3, 2.0));
}

TEST(Alignment, KeepsTheHomographyThatIsBetterDetermined) {
  // There is texture in only one corner, which says little about the other corners.
  const Eigen::Matrix3d truth = tilt();
  AlignmentScene scene = planeScene(10, truth);
  cv::Mat rest = scene.reference.images[0];
  rest(cv::Rect(150, 0, 490, 480)).setTo(90);
  rest(cv::Rect(0, 150, 640, 330)).setTo(90);
  for (cv::KeyPoint& keypoint : scene.reference.keypoints) keypoint.pt *= 0.3F;
  const AlignmentScene corner(rest, scene.target.images[0], truth, 8.0);
  const AlignmentResult result = align(corner, truth);
  ASSERT_GT(result.points.size(), 12u);
  EXPECT_EQ(result.status, AlignmentStatus::not_better);
  EXPECT_EQ(result.answer.homography, truth);
}

TEST(Alignment, WorksWithAnyNumberOfMatches) {
  const Eigen::Matrix3d truth = translation(0.6, 0.2);
  AlignmentScene scene = planeScene(11, truth);
  const std::vector<Correspondence> all = scene.matches;
  ASSERT_GT(all.size(), 200u);
  std::mt19937 generator(1);
  for (std::size_t n = 0; n <= 200; ++n) {
    scene.matches = all;
    std::shuffle(scene.matches.begin(), scene.matches.end(), generator);
    scene.matches.resize(n);
    const AlignmentResult result = align(scene, translation(1.0, 0.0));
    EXPECT_EQ(result.tried, n);
    EXPECT_EQ(result.points.size() + dropped(result), n);
    EXPECT_EQ(result.status == AlignmentStatus::too_few_points, result.points.size() < 12) << n;
    if (result.status == AlignmentStatus::ok) {
      EXPECT_LT(cornerError(result, truth), 0.05) << n;
    }
  }
}

TEST(Alignment, TakesNoMoreThanTheWantedPointsAndSpreadsThem) {
  AlignmentOptions options;
  options.points = 40;
  const Eigen::Matrix3d truth = translation(0.6, 0.2);
  const AlignmentResult result = align(planeScene(12, truth), truth, options);
  EXPECT_EQ(result.tried, 40u);
  int quarter[4] = {};
  for (const AlignedPoint& p : result.points) {
    ++quarter[(p.reference.x() > 320 ? 1 : 0) + (p.reference.y() > 240 ? 2 : 0)];
  }
  for (const int count : quarter) EXPECT_GE(count, 6);
}

TEST(PointSpread, PointsLessThanFourPixelsApartCountOnce) {
  const std::vector<Eigen::Vector2d> points{{10, 10}, {13.9, 10}, {14, 10}, {10, 14}, {12, 12}};
  std::vector<std::uint32_t> chosen;
  PointSpread().choose(points, cv::Size(100, 100), 1, chosen);
  EXPECT_EQ(chosen, std::vector<std::uint32_t>{0});
  PointSpread().choose(points, cv::Size(60, 60), 4, chosen);  // one cell is 30 px wide
  EXPECT_EQ(chosen, (std::vector<std::uint32_t>{0, 2, 3}));
}

TEST(Alignment, WithoutImagesOrSwitchedOffReturnsItsInput) {
  AlignmentScene scene = planeScene(13, Eigen::Matrix3d::Identity());
  AlignmentOptions options;
  options.enabled = false;
  const AlignmentResult off = align(scene, translation(0.5, 0.0), options);
  EXPECT_EQ(off.status, AlignmentStatus::not_run);
  EXPECT_EQ(off.tried, 0u);
  scene.target.images.clear();
  const AlignmentResult none = align(scene, translation(0.5, 0.0));
  EXPECT_EQ(none.status, AlignmentStatus::no_images);
  for (const AlignmentResult& result : {off, none}) {
    EXPECT_EQ(result.answer.homography, translation(0.5, 0.0));
  }
}

TEST(Alignment, RefusesBadIndices) {
  AlignmentScene scene = planeScene(15, Eigen::Matrix3d::Identity());
  scene.matches.push_back({0, static_cast<std::int32_t>(scene.target.size()), 0, 1, Level::ktgp});
  EXPECT_THROW(align(scene, Eigen::Matrix3d::Identity()), std::invalid_argument);
}

/// Mean squared Mahalanobis distance of H from the truth over noisy pairs of a picture with a
/// keypoint every `spacing` px.
double normalisedError(double spacing) {
  const test::WavePicture picture(16);
  std::mt19937 generator(2);
  std::normal_distribution<double> noise(0.0, 5.0);
  const auto noisy = [&](const Eigen::Matrix3d& back) {
    return test::render({320, 240}, [&](const Eigen::Vector2d& x) {
      return picture.at(test::apply(back, x)) + noise(generator);
    });
  };
  const Eigen::Matrix3d truth = translation(1.2, -0.7);
  double sum = 0.0;
  constexpr int kTrials = 60;
  for (int trial = 0; trial < kTrials; ++trial) {
    AlignmentScene scene(noisy(Eigen::Matrix3d::Identity()), noisy(truth.inverse()), truth, spacing,
                         25.0);
    disturb(1.2, scene);
    const AlignmentResult result = align(scene, truth);
    EXPECT_EQ(result.status, AlignmentStatus::ok);
    sum += test::squaredDeviation(result.answer, truth);
  }
  return sum / kTrials;
}

// Eight on average, one for each entry, if the covariance is right. Patches of 16 px at keypoints
// 8 px apart contain the same noise four times, which counts once.
TEST(Alignment, CovarianceMatchesErrors) {
  for (const double spacing : {17.0, 8.0}) {
    const double error = normalisedError(spacing);
    EXPECT_GT(error, 5.0) << spacing;
    EXPECT_LT(error, 13.0) << spacing;
  }
}

}  // namespace
}  // namespace ktgp_orb

namespace ktgp_orb::alignment {
namespace {

cv::Mat randomImage(std::mt19937& generator, bool extreme) {
  std::uniform_int_distribution<int> grey(0, 255);
  return test::drawn({117, 100}, [&](int, int) {
    const int value = grey(generator);
    return extreme ? 255 * (value & 1) : value;
  });
}

AffineWalk randomWalk(std::mt19937& generator) {
  std::uniform_real_distribution<double> uniform(-1.0, 1.0);
  const auto fixed = [](double x) { return static_cast<std::int32_t>(std::lrint(65536.0 * x)); };
  const double a = 1.4 * uniform(generator);
  const double b = 1.4 * uniform(generator);
  const double c = 1.4 * uniform(generator);
  const double d = 1.4 * uniform(generator);
  return {fixed(-10 * (a + b) + uniform(generator)),
          fixed(-10 * (c + d) + uniform(generator)),
          fixed(a),
          fixed(c),
          fixed(b),
          fixed(d)};
}

// The sums of a whole patch must have the same bits for every width of the vectors.
TEST(AlignmentKernels, EqualThePlainLoopsToTheLastBit) {
  const AlignmentKernels& plain = portableAlignmentKernels();
  for (const AlignmentKernels* set : test::everyKernels(bestAlignmentKernels, plain)) {
    SCOPED_TRACE(set->name);
    std::mt19937 generator(3);
    std::uniform_real_distribution<float> fraction(0.F, 1.F);
    for (int trial = 0; trial < 200; ++trial) {
      const cv::Mat image = randomImage(generator, trial % 5 == 0);
      const AffineWalk walk = randomWalk(generator);
      const auto stride = static_cast<std::ptrdiff_t>(image.step);
      alignas(64) float patch[2][kWarpSide * kWarpPitch];
      alignas(64) float window[2][kWindowSide * kWindowPitch];
      PatchTemplate prepared[2];
      const AlignmentKernels* kernels[2] = {&plain, set};
      MatchSums matched[2];
      const float fx = fraction(generator);
      const float fy = fraction(generator);
      for (int k = 0; k < 2; ++k) {
        std::memset(window[k], 0, sizeof window[k]);
        std::memset(&prepared[k], 0, sizeof prepared[k]);  // also what lies behind its last member
        kernels[k]->warp(image.ptr<std::uint8_t>(50) + 55, stride, walk, patch[k]);
        kernels[k]->prepare(patch[k], prepared[k]);
        kernels[k]->smooth(image.ptr<std::uint8_t>(20) + 31, stride, window[k]);
        matched[k] = kernels[k]->compare(window[k] + 3 * kWindowPitch + 7, fx, fy, prepared[k]);
      }
      ASSERT_EQ(std::memcmp(patch[0], patch[1], sizeof patch[0]), 0);
      ASSERT_EQ(std::memcmp(&prepared[0], &prepared[1], sizeof prepared[0]), 0);
      for (int row = 0; row < kWindowSide; ++row) {
        const int first = row * kWindowPitch;
        ASSERT_EQ(std::memcmp(window[0] + first, window[1] + first, sizeof(float) * kWindowSide),
                  0);
      }
      ASSERT_EQ(std::memcmp(&matched[0], &matched[1], sizeof matched[0]), 0);
    }
  }
}

TEST(AlignmentKernels, WarpInterpolatesBetweenFourPixels) {
  const cv::Mat plane = test::drawn({80, 60}, [](int x, int y) { return x + 2 * y; });
  const AffineWalk walk{-300000, -400000, 60000, -9000, 12000, 70000};
  float patch[kWarpSide * kWarpPitch];
  portableAlignmentKernels().warp(plane.ptr<std::uint8_t>(25) + 30,
                                  static_cast<std::ptrdiff_t>(plane.step), walk, patch);
  for (int row = 0; row < kWarpSide; ++row) {
    for (int column = 0; column < kWarpSide; ++column) {
      const double x = (walk.x0 + column * walk.x_column + row * walk.x_row) / 65536.0;
      const double y = (walk.y0 + column * walk.y_column + row * walk.y_row) / 65536.0;
      ASSERT_NEAR(patch[row * kWarpPitch + column], 30 + x + 2 * (25 + y), 0.02);
    }
  }
}

}  // namespace
}  // namespace ktgp_orb::alignment
