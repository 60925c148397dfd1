#include "ktgp_orb/metrics.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <limits>
#include <random>

#include "synthetic_pairs.h"

namespace ktgp_orb::metrics {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();

Features featuresAt(const std::vector<cv::Point2f>& points, float size = 31.F,
                    const cv::Size& image_size = {640, 480}) {
  Features features;
  for (const cv::Point2f& p : points) features.keypoints.emplace_back(p, size);
  features.descriptors = cv::Mat::zeros(static_cast<int>(points.size()), kDescriptorBytes, CV_8U);
  features.image_size = image_size;
  return features;
}

std::vector<Correspondence> oneToOne(int n) {
  std::vector<Correspondence> matches(static_cast<std::size_t>(n), {0, 0, 0, 0, Level::ktgp});
  for (int i = 0; i < n; ++i) matches[i].reference_index = matches[i].target_index = i;
  return matches;
}

using test::translation;

TEST(Summary, MeanAndRootMeanSquareByHand) {
  const ErrorSummary s = summarize({1.0, 2.0, 2.0});
  EXPECT_EQ(s.count, 3u);
  EXPECT_DOUBLE_EQ(s.mean, 5.0 / 3.0);
  EXPECT_DOUBLE_EQ(s.rms, std::sqrt(3.0));
  EXPECT_EQ(summarize({}).count, 0u);
  EXPECT_EQ(summarize({}).mean, 0.0);
}

TEST(Median, MiddleOfSortedValues) {
  EXPECT_EQ(median({}), 0.0);
  EXPECT_EQ(median({7.0}), 7.0);
  EXPECT_EQ(median({9.0, 1.0, 2.0}), 2.0);
  EXPECT_EQ(median({4.0, 1.0, 9.0, 2.0}), 3.0);
  EXPECT_EQ(median({1.0, kInfinity, kInfinity}), kInfinity);
}

TEST(DescriptorDistance, CountsMatchesOfTheLevelOnly) {
  const std::vector<Correspondence> c{{0, 0, 100, 101, Level::knn},
                                      {0, 1, 30, 60, Level::kt},
                                      {0, 2, 10, 60, Level::ktgp},
                                      {0, 3, 20, 60, Level::ktgp}};
  const ErrorSummary all = descriptorDistance(c);
  EXPECT_EQ(all.count, 4u);
  EXPECT_DOUBLE_EQ(all.mean, 40.0);
  const ErrorSummary final = descriptorDistance(c, Level::ktgp);
  EXPECT_EQ(final.count, 2u);
  EXPECT_DOUBLE_EQ(final.mean, 15.0);
  EXPECT_DOUBLE_EQ(final.rms, std::sqrt(250.0));
}

TEST(Displacement, EqualsMotionInTheImage) {
  const Features a = featuresAt({{10, 10}, {20, 20}});
  const Features b = featuresAt({{13, 14}, {20, 20}});
  const ErrorSummary s = displacement(a, b, oneToOne(2));
  EXPECT_DOUBLE_EQ(s.mean, 2.5);
  EXPECT_DOUBLE_EQ(s.rms, std::sqrt(12.5));
}

TEST(Shares, ByHandAndOfNothing) {
  EXPECT_DOUBLE_EQ(retention(3, 4), 0.75);
  EXPECT_EQ(retention(0, 0), 0.0);
  const Features two = featuresAt({{1, 1}, {2, 2}});
  const Features six = featuresAt({{1, 1}, {2, 2}, {3, 3}, {4, 4}, {5, 5}, {6, 6}});
  EXPECT_DOUBLE_EQ(matchedShare(2, two, six), 0.5);
  EXPECT_EQ(matchedShare(0, Features{}, Features{}), 0.0);
}

TEST(ReprojectionErrors, MeasureInTheTargetImage) {
  // Doubles the image, then moves it by (1, 0).
  Eigen::Matrix3d h = Eigen::Vector3d(2.0, 2.0, 1.0).asDiagonal();
  h(0, 2) = 1.0;
  const Features a = featuresAt({{10, 20}, {5, 5}, {0, 0}});
  const Features b = featuresAt({{21, 40}, {14, 14}, {1, 2}});
  const std::vector<double> errors = reprojectionErrors(h, a, b, oneToOne(3));
  EXPECT_EQ(errors, (std::vector<double>{0.0, 5.0, 2.0}));
  EXPECT_EQ(reprojectionErrors(-3.0 * h, a, b, oneToOne(3)), errors) << "H is known up to a factor";
  EXPECT_EQ(countWithin(errors, 2.0), 2u);
  EXPECT_DOUBLE_EQ(precision(errors, 2.0), 2.0 / 3.0);
  EXPECT_DOUBLE_EQ(precision(errors, 1.9), 1.0 / 3.0);
  EXPECT_EQ(precision({}, 3.0), 0.0);
}

TEST(ReprojectionErrors, AreInfiniteBeyondTheHorizon) {
  Eigen::Matrix3d h = Eigen::Matrix3d::Identity();
  h(2, 0) = -0.01;  // the horizon is at x = 100
  const Features a = featuresAt({{50, 0}, {100, 0}, {150, 0}});
  const Features b = featuresAt({{100, 0}, {0, 0}, {-300, 0}});
  const std::vector<double> errors = reprojectionErrors(h, a, b, oneToOne(3));
  EXPECT_DOUBLE_EQ(errors[0], 0.0);
  EXPECT_EQ(errors[1], kInfinity);
  EXPECT_EQ(errors[2], kInfinity);
}

/// A view with its horizon across the image, and the origin behind it.
Eigen::Matrix3d viewWithHorizon() {
  Eigen::Matrix3d h;
  h << 1.0, -1.6, 320.0, 0.0, -0.6, 300.0, 0.0, -0.005, 1.0;
  return h;
}

TEST(Project, KnowsTheSideOfTheHorizonThatIsSeen) {
  const Eigen::Matrix3d h = viewWithHorizon();
  for (const double factor : {1.0, -1.0, 0.01, -50.0}) {
    for (const Eigen::Matrix3d& seen :
         {Eigen::Matrix3d(factor * h), Eigen::Matrix3d(factor * h.inverse())}) {
      // On both sides of the horizon, a mapped point is mapped back by the inverse.
      const Eigen::Matrix3d back = seen.inverse();
      for (const Eigen::Vector2d& x :
           {Eigen::Vector2d(100.0, 300.0), Eigen::Vector2d(500.0, 450.0),
            Eigen::Vector2d(20.0, 40.0), Eigen::Vector2d(600.0, 120.0)}) {
        const Eigen::Vector2d u = project(seen, x);
        const double side = (seen.row(2) * x.homogeneous()).value() * seen.determinant();
        ASSERT_EQ(u.allFinite(), side > 0.0) << x.transpose() << ", factor " << factor;
        if (!u.allFinite()) continue;
        EXPECT_LT((project(back, u) - x).norm(), 1e-6) << x.transpose() << ", factor " << factor;
      }
    }
  }
  EXPECT_FALSE(project(Eigen::Matrix3d::Zero(), {1.0, 2.0}).allFinite());
  const Eigen::Matrix3d mirror = Eigen::Vector3d(-1.0, 1.0, 1.0).asDiagonal();
  EXPECT_EQ(project(mirror, {3.0, 4.0}), Eigen::Vector2d(-3.0, 4.0));
}

TEST(Repeatability, FindsAllPointsOfAFloorAtASlantAgain) {
  // A floor seen from above, and by a camera on it: everything above y = 250 is behind that camera,
  // including the origin of the first image.
  Eigen::Matrix3d truth;
  truth << -1.0, 15.2, -3940.0, 0.0, -0.9, 700.0, 0.0, 0.004, -1.0;
  std::vector<cv::Point2f> above;
  std::vector<cv::Point2f> oblique;
  for (int row = 0; row < 6; ++row) {
    for (int column = 0; column < 10; ++column) {
      const Eigen::Vector2d x(170.0 + 30.0 * column, 380.0 + 18.0 * row);
      const Eigen::Vector3d p = truth * x.homogeneous();
      ASSERT_GT(p.z(), 0.0);
      above.emplace_back(static_cast<float>(x.x()), static_cast<float>(x.y()));
      oblique.emplace_back(static_cast<float>(p.x() / p.z()), static_cast<float>(p.y() / p.z()));
    }
  }
  const Features a = featuresAt(above, 8.F, {4000, 4000});
  const Features b = featuresAt(oblique, 8.F, {4000, 4000});
  for (const double factor : {1.0, -1.0}) {
    for (const double error : reprojectionErrors(factor * truth, a, b, oneToOne(60))) {
      EXPECT_LT(error, 0.01);
    }
    for (const double error : reprojectionErrors(factor * truth.inverse(), b, a, oneToOne(60))) {
      EXPECT_LT(error, 0.05);
    }
    const Repeatability found = detectorRepeatability(a, b, factor * truth, 0.99);
    EXPECT_EQ(found.reference_common, 60u);
    EXPECT_EQ(found.target_common, 60u);
  }
}

TEST(CornerError, ByHand) {
  const cv::Size size(101, 51);
  EXPECT_EQ(cornerError(translation(5, 5), translation(5, 5), size), 0.0);
  EXPECT_DOUBLE_EQ(cornerError(translation(8, 9), translation(5, 5), size), 5.0);
  // Twice as wide: the two right corners move by 100 px.
  const Eigen::Matrix3d wide = Eigen::Vector3d(2.0, 1.0, 1.0).asDiagonal();
  EXPECT_DOUBLE_EQ(cornerError(wide, Eigen::Matrix3d::Identity(), size), 50.0);
  EXPECT_EQ(cornerError(Eigen::Matrix3d::Zero(), translation(0, 0), size), kInfinity);
}

/// The definition of the curve of areaUnderCurve at x: straight lines between the sorted errors
/// below the threshold, from (0, 0) on.
double shareAt(double x, std::vector<double> errors, double threshold) {
  std::sort(errors.begin(), errors.end());
  double left = 0.0;
  double n = 0.0;
  for (const double right : errors) {
    if (right >= threshold) break;
    if (x < right) return (n + (x - left) / (right - left)) / static_cast<double>(errors.size());
    left = right;
    n += 1.0;
  }
  return errors.empty() ? 0.0 : n / static_cast<double>(errors.size());
}

TEST(AreaUnderCurve, EqualsADirectIntegral) {
  std::mt19937 random(7);
  std::uniform_real_distribution<double> error(0.0, 12.0);
  for (int n = 0; n <= 60; n += 10) {
    std::vector<double> errors(n);
    for (int i = 0; i < n; ++i) errors[i] = i % 7 == 0 ? kInfinity : error(random);
    for (double threshold : {1.0, 3.0, 5.0, 10.0}) {
      constexpr int kSteps = 10000;
      double area = 0.0;
      for (int i = 0; i < kSteps; ++i) {
        area += shareAt((i + 0.5) * threshold / kSteps, errors, threshold) / kSteps;
      }
      EXPECT_NEAR(areaUnderCurve(errors, threshold), area, 1e-4) << n << " at " << threshold;
    }
  }
}

// pose_auc of SuperGlue's models/utils.py, by hand.
TEST(AreaUnderCurve, ByHand) {
  EXPECT_DOUBLE_EQ(areaUnderCurve({0.0, 0.0}, 1.0), 1.0);
  EXPECT_DOUBLE_EQ(areaUnderCurve({1.0}, 4.0), 0.875);
  EXPECT_DOUBLE_EQ(areaUnderCurve({3.0, 1.0}, 2.0), 0.375);
  EXPECT_DOUBLE_EQ(areaUnderCurve({1.0, 4.0, kInfinity, 0.0}, 2.0), 0.4375);
  EXPECT_DOUBLE_EQ(areaUnderCurve({2.0, 2.0}, 2.0), 0.0);
  EXPECT_EQ(areaUnderCurve({}, 3.0), 0.0);
}

// --- repeatability ---

TEST(Repeatability, SameKeypointsGiveOne) {
  const Features a = featuresAt({{100, 100}, {300, 200}, {500, 400}});
  const Repeatability r = detectorRepeatability(a, a, Eigen::Matrix3d::Identity());
  EXPECT_EQ(r.repeated, 3u);
  EXPECT_DOUBLE_EQ(r.score(), 1.0);
}

TEST(Repeatability, LeavesOutKeypointsOutsideTheOtherImage) {
  const Features a = featuresAt({{10, 100}, {300, 200}, {500, 400}});
  const Features b = featuresAt({{200, 200}, {630, 10}});
  const Repeatability r = detectorRepeatability(a, b, translation(-100, 0));
  EXPECT_EQ(r.reference_common, 2u);  // the first has left the image
  EXPECT_EQ(r.target_common, 1u);     // (730, 10) is outside the reference
  EXPECT_EQ(r.repeated, 1u);
  EXPECT_DOUBLE_EQ(r.score(), 1.0);
}

TEST(Repeatability, PairsOneToOneAndTheBestFirst) {
  const Features a = featuresAt({{100, 100}, {104, 100}});
  const Features b = featuresAt({{104, 100}});
  EXPECT_EQ(detectorRepeatability(a, b, Eigen::Matrix3d::Identity()).repeated, 1u);
  EXPECT_EQ(detectorRepeatability(b, a, Eigen::Matrix3d::Identity()).repeated, 1u);
}

/// Two unit discs at distance d: their common area, in closed form.
double lens(double d) {
  return 2.0 * std::acos(d / 2.0) - d / 2.0 * std::sqrt(4.0 - d * d);
}

TEST(Repeatability, OverlapOfEqualDiscsAgreesWithTheClosedForm) {
  // Discs of 30 px radius after normalisation, for every size of the keypoint.
  for (float size : {31.F, 60.F, 90.F}) {
    for (int d = 1; d < 40; ++d) {
      const double common = lens(d / 30.0);
      const double error = 1.0 - common / (2.0 * CV_PI - common);
      const Features a = featuresAt({{100, 100}}, size);
      const Features b = featuresAt({{100.F + d, 100}}, size);
      const Eigen::Matrix3d same = Eigen::Matrix3d::Identity();
      EXPECT_EQ(detectorRepeatability(a, b, same, error + 0.003).repeated, 1u) << d;
      EXPECT_EQ(detectorRepeatability(a, b, same, error - 0.003).repeated, 0u) << d;
    }
  }
}

TEST(Repeatability, OverlapFollowsScaleAndShape) {
  const Features a = featuresAt({{100, 100}}, 31.F);
  const Eigen::Matrix3d twice = Eigen::Vector3d(2.0, 2.0, 1.0).asDiagonal();
  EXPECT_EQ(detectorRepeatability(a, featuresAt({{200, 200}}, 62.F), twice, 0.01).repeated, 1u);
  EXPECT_EQ(detectorRepeatability(a, featuresAt({{200, 200}}, 31.F), twice).repeated, 0u);
  // An ellipse of twice the width over a disc of its height: half of it overlaps.
  const Eigen::Matrix3d wide = Eigen::Vector3d(2.0, 1.0, 1.0).asDiagonal();
  const Features disc = featuresAt({{200, 100}}, 31.F);
  EXPECT_EQ(detectorRepeatability(a, disc, wide, 0.51).repeated, 1u);
  EXPECT_EQ(detectorRepeatability(a, disc, wide, 0.49).repeated, 0u);
  // Rotated, it overlaps the disc by the same area.
  for (const double angle : {0.4, 0.8, 2.0}) {
    Eigen::Matrix3d turned = Eigen::Matrix3d::Identity();
    turned.topLeftCorner<2, 2>() =
        Eigen::Rotation2Dd(angle).toRotationMatrix() * wide.topLeftCorner<2, 2>();
    turned.topRightCorner<2, 1>() = Eigen::Vector2d(200.0, 100.0) -
                                    turned.topLeftCorner<2, 2>() * Eigen::Vector2d(100.0, 100.0);
    EXPECT_EQ(detectorRepeatability(a, disc, turned, 0.51).repeated, 1u) << angle;
    EXPECT_EQ(detectorRepeatability(a, disc, turned, 0.49).repeated, 0u) << angle;
  }
}

/// The overlap error of a disc that is mapped to an ellipse twice as long as wide and turned by
/// `angle`, and another disc 40 px further along the ellipse; to 0.005.
double errorAlongTurnedEllipse(double angle) {
  const Eigen::Matrix2d turn = Eigen::Rotation2Dd(angle).toRotationMatrix();
  const Eigen::Vector2d centre(200.0, 200.0);
  Eigen::Matrix3d h = Eigen::Matrix3d::Identity();
  h.topLeftCorner<2, 2>() = turn * Eigen::Vector2d(2.0, 1.0).asDiagonal();
  h.topRightCorner<2, 1>() = centre - h.topLeftCorner<2, 2>() * Eigen::Vector2d(100.0, 100.0);
  const Eigen::Vector2d moved = centre + turn * Eigen::Vector2d(40.0, 0.0);
  const Features disc = featuresAt({cv::Point2d(moved.x(), moved.y())}, 31.F);
  double error = 0.0;
  while (detectorRepeatability(featuresAt({{100, 100}}, 31.F), disc, h, error).repeated == 0) {
    error += 0.005;
  }
  return error;
}

TEST(Repeatability, OverlapOfATurnedEllipseIsThatOfTheUnturned) {
  const double unturned = errorAlongTurnedEllipse(0.0);
  EXPECT_GT(unturned, 0.55);  // otherwise the disc is inside the ellipse and the test is void
  EXPECT_LT(unturned, 0.95);
  for (const double angle : {0.4, 0.8, 1.2, 2.0, 2.8}) {
    EXPECT_NEAR(errorAlongTurnedEllipse(angle), unturned, 0.0075) << angle;
  }
}

TEST(Repeatability, NoKeypointsGiveZero) {
  const Features none = featuresAt({});
  const Features one = featuresAt({{5, 5}});
  EXPECT_EQ(detectorRepeatability(none, one, Eigen::Matrix3d::Identity()).score(), 0.0);
  EXPECT_EQ(detectorRepeatability(one, none, Eigen::Matrix3d::Identity()).score(), 0.0);
}

}  // namespace
}  // namespace ktgp_orb::metrics
