// The covariance describes the error of the homography, also when neighbouring points have similar
// errors.
#include "core/homography/smooth_field.h"
#include "core/homography/fit.h"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <functional>
#include <string>
#include <vector>

#include "core/homography/transform.h"
#include "synthetic_pairs.h"

namespace ktgp_orb::homography {
namespace {

using test::Numbers;

const cv::Size kSize(640, 480);

/// Results over many scenes with known truth.
struct Consistency {
  double median = 0.0;        ///< of e' S^-1 e at the corners; 1.39 if S is right
  double within = 0.0;        ///< share below 13.8, the 99.9 % bound
  double noise_within = 0.0;  ///< the same with only the noise's part of S
  double deviation = 0.0;     ///< median of plane_deviation, px
};

/// Errors at the points of one scene.
using Errors =
    std::function<std::vector<Eigen::Vector2d>(const std::vector<Eigen::Vector2d>&, Numbers&)>;

double normalised(const Eigen::Vector2d& error, const Eigen::Matrix<double, 2, 8>& jacobian,
                  const Covariance8& covariance) {
  const Eigen::Matrix2d spread = jacobian * covariance * jacobian.transpose();
  return error.dot(spread.inverse() * error);
}

double median(std::vector<double> values) {
  std::sort(values.begin(), values.end());
  return values[values.size() / 2];
}

/// `by_cell`: also has two thirds of the points in a ninth of the image.
Consistency measure(const Errors& errors, std::size_t points, double min_scale,
                    bool by_cell = false, bool of_patches = false) {
  constexpr int kScenes = 300;
  Numbers numbers(1);
  HomographyRefiner refiner;
  EvidenceOptions options;
  options.min_scale = min_scale;
  options.by_cell = by_cell;
  options.of_patches = of_patches;
  std::vector<double> all, of_noise, deviations;
  for (int scene = 0; scene < kScenes; ++scene) {
    const Eigen::Matrix3d truth = test::randomHomography(kSize, 0.1, numbers);
    std::vector<Eigen::Vector2d> reference, target;
    while (reference.size() < points) {
      const Eigen::Vector2d any = numbers.pointIn(kSize);
      reference.push_back(by_cell && reference.size() % 3 != 0 ? any / 3.0 : any);
    }
    const std::vector<Eigen::Vector2d> off = errors(reference, numbers);
    for (std::size_t i = 0; i < points; ++i)
      target.push_back(project(truth, reference[i]) + off[i]);
    UncertainHomography found;
    found.homography = truth;
    EXPECT_TRUE(refiner.refine(reference, target, kSize, options, found));
    deviations.push_back(found.plane_deviation);
    for (const Eigen::Vector2d& corner : imageCorners(kSize, {})) {
      const Eigen::Vector2d error = project(found.homography, corner) - project(truth, corner);
      const auto jacobian = jacobianByEntries(found.homography, corner);
      all.push_back(normalised(error, jacobian, found.covariance));
      of_noise.push_back(normalised(error, jacobian, found.covariance - found.shared_covariance));
    }
  }
  const auto share = [](const std::vector<double>& values) {
    const auto below = [](double value) { return value < 13.8; };
    return static_cast<double>(std::count_if(values.begin(), values.end(), below)) /
           static_cast<double>(values.size());
  };
  return {median(all), share(all), share(of_noise), median(deviations)};
}

Eigen::Vector2d white(double sigma, Numbers& numbers) {
  const double x = sigma * numbers.normal();
  return {x, sigma * numbers.normal()};
}

/// A field of standard deviation about `tau`: a few wide hills at random positions.
Errors hills(double tau, double sigma) {
  return [=](const std::vector<Eigen::Vector2d>& points, Numbers& numbers) {
    constexpr int kHills = 40;
    constexpr double kWidth = 150.0;  // px
    std::vector<Eigen::Vector2d> places, heights;
    for (int i = 0; i < kHills; ++i) {
      places.emplace_back(numbers.uniform(-200.0, 840.0), numbers.uniform(-200.0, 680.0));
      heights.push_back(white(1.0, numbers));
    }
    std::vector<Eigen::Vector2d> errors;
    double squares = 0.0;
    for (const Eigen::Vector2d& p : points) {
      Eigen::Vector2d sum = Eigen::Vector2d::Zero();
      for (int i = 0; i < kHills; ++i) {
        const double d2 = (p - places[static_cast<std::size_t>(i)]).squaredNorm();
        sum += std::exp(-0.5 * d2 / (kWidth * kWidth)) * heights[static_cast<std::size_t>(i)];
      }
      errors.push_back(sum);
      squares += sum.squaredNorm() / 2.0;
    }
    const double scale = tau / std::sqrt(squares / static_cast<double>(points.size()));
    for (Eigen::Vector2d& e : errors) e = scale * e + white(sigma, numbers);
    return errors;
  };
}

/// Outward distortion of a lens: r³ from the middle.
Errors lens(double at_corner, double sigma) {
  return [=](const std::vector<Eigen::Vector2d>& points, Numbers& numbers) {
    const Eigen::Vector2d middle(319.5, 239.5);
    std::vector<Eigen::Vector2d> errors;
    for (const Eigen::Vector2d& p : points) {
      const Eigen::Vector2d out = (p - middle) / middle.norm();
      errors.emplace_back(at_corner * out.squaredNorm() * out + white(sigma, numbers));
    }
    return errors;
  };
}

/// Independent ones; `octaves`: 1.2^o times as large for keypoints of octave o.
Errors noise(double sigma, double octaves = 0.0) {
  return [=](const std::vector<Eigen::Vector2d>& points, Numbers& numbers) {
    std::vector<Eigen::Vector2d> errors(points.size());
    for (Eigen::Vector2d& e : errors) {
      const double octave = octaves > 0.0 ? std::floor(numbers.uniform(0.0, octaves)) : 0.0;
      e = white(sigma * std::pow(1.2, octave), numbers);
    }
    return errors;
  };
}

struct Case {
  const char* name;
  Errors errors;
  std::vector<std::size_t> points;
  double min_scale;
  bool by_cell;
  double lowest, highest;  ///< bounds of the median
  double within;           ///< at least
};

TEST(SmoothField, ErrorsAreCovered) {
  const std::vector<std::size_t> few_and_many{40, 150, 400, 1500};
  const std::vector<Case> cases{
      {"white noise", noise(0.5), few_and_many, 1e-4, false, 0.8, 1.8, 0.99},
      {"that grows with the pyramid level", noise(0.4, 8.0), {300}, 1e-4, false, 0.5, 1.8, 0.99},
      // Unequal weights of the pairs are part of the covariance.
      {"weighed by cell", noise(0.5), few_and_many, 1e-4, true, 0.5, 2.2, 0.98},
      {"hills weighed by cell", hills(0.5, 0.3), {400}, 1e-4, true, 0.2, 2.5, 0.95},
      // A common error counts once, for any number of points.
      {"hills", hills(0.5, 0.05), {100, 1600}, 1.0, false, 0.0, 1e9, 0.9},
      // The error at the corners, where H is compared, is the largest.
      {"lens", lens(2.0, 0.05), {400}, 1.0, false, 0.0, 6.0, 0.9}};
  for (const Case& each : cases) {
    for (const std::size_t points : each.points) {
      SCOPED_TRACE(each.name + (", " + std::to_string(points)));
      const Consistency c = measure(each.errors, points, each.min_scale, each.by_cell);
      EXPECT_GT(c.median, each.lowest);
      EXPECT_LT(c.median, each.highest);
      EXPECT_GT(c.within, each.within);
    }
  }
}

TEST(SmoothField, TheDeviationFromAPlaneIsThatOfTheScene) {
  for (const double sigma : {0.03, 0.3}) {
    const Consistency c = measure(hills(0.5, sigma), 400, 1.0);
    EXPECT_LT(c.median, 2.5) << sigma;
    EXPECT_GT(c.median, 0.2) << sigma;
    EXPECT_GT(c.within, 0.95) << sigma;
    EXPECT_LT(c.noise_within, 0.7) << "as if the errors were independent, " << sigma;
    EXPECT_GT(c.deviation, 0.25) << sigma;
    EXPECT_LT(c.deviation, 1.5) << sigma;
  }
  EXPECT_GT(measure(lens(2.0, 0.05), 400, 1.0).deviation, 0.1);
  EXPECT_LT(measure(noise(0.5), 400, 1e-4).deviation, 0.1);
}

TEST(SmoothField, OfPatchesCoversTheErrors) {
  const Consistency c = measure(noise(0.2), 150, 1e-4, false, true);
  EXPECT_GT(c.median, 0.5);
  EXPECT_LT(c.median, 1.8);
}

/// The error at the corners, squared, of homographies from points that are rounded to whole pixels.
double ofRounded(double zoom) {
  Numbers numbers(3);
  HomographyRefiner refiner;
  EvidenceOptions options;
  options.rounding = 1.0 / std::sqrt(12.0);
  std::vector<double> all;
  for (int scene = 0; scene < 300; ++scene) {
    Eigen::Matrix3d truth = Eigen::Vector3d(zoom, zoom, 1.0).asDiagonal();
    truth(0, 2) = numbers.uniform(0.0, 1.0);
    truth(1, 2) = numbers.uniform(0.0, 1.0);
    std::vector<Eigen::Vector2d> reference, target;
    for (int i = 0; i < 200; ++i) {
      reference.push_back(numbers.pointIn(kSize).array().round());
      target.push_back(project(truth, reference.back()).array().round());
    }
    UncertainHomography found;
    found.homography = truth;
    EXPECT_TRUE(refiner.refine(reference, target, kSize, options, found));
    for (const Eigen::Vector2d& corner : imageCorners(kSize, {})) {
      const Eigen::Vector2d error = project(found.homography, corner) - project(truth, corner);
      all.push_back(
          normalised(error, jacobianByEntries(found.homography, corner), found.covariance));
    }
  }
  return median(all);
}

// Where points move alike they are rounded alike; where they do not, that is noise which the errors
// show.
TEST(SmoothField, RoundingCountsAsFarAsItIsAlike) {
  for (const double zoom : {1.0005, 1.37}) {
    const double found = ofRounded(zoom);
    EXPECT_GT(found, 0.5) << zoom;
    EXPECT_LT(found, 3.0) << zoom;
  }
}

TEST(SmoothField, OverlappingPatchesAreFewerIndependentOnes) {
  PointArrays<double> pairs;
  pairs.resize(16);
  Numbers numbers(4);
  for (int i = 0; i < 16; ++i) {
    Eigen::Vector2d x(i % 4, i / 4);  // NOLINT(bugprone-integer-division)
    if (i == 15) x = {2.25, 3.0};     // half of its patch is that of pair 14
    pairs.set(static_cast<std::size_t>(i), x, x + white(0.01, numbers));
  }
  const FieldFit fit = SmoothField().fit(pairs, std::vector<double>(16, 1.0), 1.0,
                                         Eigen::Matrix3d::Identity(), {5.0, 0.0, 0.5});
  EXPECT_NEAR(fit.shared_patches, 1.0 + 2.0 * 0.5 / 16.0, 1e-12);
}

TEST(SmoothField, IsZeroForTooFewPairs) {
  PointArrays<double> pairs;
  pairs.resize(8);
  Numbers numbers(2);
  for (std::size_t i = 0; i < 8; ++i) {
    const Eigen::Vector2d x(numbers.uniform(-1.0, 1.0), numbers.uniform(-1.0, 1.0));
    pairs.set(i, x, x + white(0.01, numbers));
  }
  const FieldFit fit = SmoothField().fit(pairs, std::vector<double>(8, 1.0), 1.0,
                                         Eigen::Matrix3d::Identity(), {4.0, 0.0, 0.1});
  EXPECT_EQ(fit.variance, 0.0);
  EXPECT_EQ(fit.noise_share, 1.0);
  EXPECT_TRUE(fit.covariance.isZero());
}

}  // namespace
}  // namespace ktgp_orb::homography
