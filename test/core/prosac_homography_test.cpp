#include "ktgp_orb/prosac_homography.h"

#include <gtest/gtest.h>

#include <Eigen/Eigenvalues>
#include <Eigen/Geometry>
#include <Eigen/LU>
#include <algorithm>
#include <limits>
#include <opencv2/calib3d.hpp>
#include <opencv2/core/eigen.hpp>
#include <stdexcept>
#include <string>

#include "allocation_counter.h"
#include "synthetic_pairs.h"

namespace ktgp_orb {
namespace {

using test::cornerError;
using test::makePairs;
using test::Numbers;
using test::Order;
using test::Scene;

const cv::Size kSize(640, 480);

/// The mask must be the threshold test on the returned H, and every figure must follow from the
/// mask.
void expectConsistent(const PointPairs& pairs, const ProsacResult& result, double threshold) {
  ASSERT_EQ(result.mask.size(), pairs.size());
  std::size_t inliers = 0;
  double sum = 0.0;
  for (std::size_t i = 0; i < pairs.size(); ++i) {
    const Eigen::Vector3d p = result.answer.homography * pairs.reference[i].homogeneous();
    const double error = (p.hnormalized() - pairs.target[i]).norm();
    const bool inlier = result.status == Status::ok && error < threshold;
    ASSERT_EQ(result.mask[i], inlier ? 1 : 0) << "pair " << i << " error " << error;
    if (!inlier) continue;
    ++inliers;
    sum += error * error;
  }
  EXPECT_EQ(result.inliers, inliers);
  EXPECT_NEAR(result.rmse, inliers > 0 ? std::sqrt(sum / static_cast<double>(inliers)) : 0.0, 1e-9);
  EXPECT_LE(result.iterations, ProsacOptions().max_iterations);
  if (result.status != Status::ok) {
    EXPECT_TRUE(result.answer.homography.isZero());
    EXPECT_TRUE(result.answer.covariance.isZero());
  } else {
    EXPECT_EQ(result.answer.homography(2, 2), 1.0);
  }
}

struct Truth {
  const char* name;
  Eigen::Matrix3d homography;
};

std::vector<Truth> truths() {
  const auto matrix = [](std::initializer_list<double> v) {
    Eigen::Matrix3d m;
    for (int i = 0; i < 9; ++i) m(i / 3, i % 3) = *(v.begin() + i);
    return m;
  };
  const double c = std::cos(0.6);
  const double s = std::sin(0.6);
  return {{"identity", Eigen::Matrix3d::Identity()},
          {"translation", matrix({1, 0, 35.5, 0, 1, -20.25, 0, 0, 1})},
          {"rotation",
           matrix({c, -s, 320 - c * 320 + s * 240, s, c, 240 - s * 320 - c * 240, 0, 0, 1})},
          {"zoom", matrix({1.7, 0, -220, 0, 1.7, -160, 0, 0, 1})},
          {"shrink", matrix({0.4, 0, 190, 0, 0.4, 140, 0, 0, 1})},
          {"perspective", matrix({0.9, 0.1, 30, -0.2, 0.7, 120, -0.0004, -0.0009, 1})}};
}

TEST(ProsacHomography, FindsEveryKindOfHomographyFromExactPairs) {
  ProsacHomography prosac;
  ProsacResult result;
  Numbers numbers(1);
  for (const Truth& truth : truths()) {
    for (std::size_t n = 0; n <= 200; ++n) {
      const PointPairs pairs = makePairs({n, n, truth.homography, Order::good, 0.0}, numbers);
      prosac.estimate(pairs, kSize, result);
      expectConsistent(pairs, result, 3.0);
      const std::string where = truth.name + (" of " + std::to_string(n));
      if (n < 4) {
        EXPECT_EQ(result.status, Status::too_few_matches) << where;
      } else if (n == 4) {
        EXPECT_EQ(result.status, Status::no_model) << where;  // any four points agree
      } else if (n >= 12) {
        ASSERT_EQ(result.status, Status::ok) << where;
      }
      if (result.status != Status::ok) continue;
      EXPECT_LT(cornerError(result.answer.homography, truth.homography, kSize), 1e-6) << where;
      EXPECT_EQ(result.inliers, n) << where;
    }
  }
}

TEST(ProsacHomography, FindsEveryKindOfHomographyAmongNoiseAndOutliers) {
  ProsacHomography prosac;
  ProsacResult result;
  Numbers numbers(2);
  for (const Truth& truth : truths()) {
    for (std::size_t n = 40; n <= 200; n += 5) {
      const PointPairs pairs = makePairs({n, n / 2, truth.homography}, numbers);
      prosac.estimate(pairs, kSize, result);
      expectConsistent(pairs, result, 3.0);
      ASSERT_EQ(result.status, Status::ok) << truth.name << " of " << n;
      EXPECT_LT(cornerError(result.answer.homography, truth.homography, kSize), 8.0)
          << truth.name << " of " << n;
    }
  }
}

/// Least squares on the reprojection error over the first `inliers` pairs, which are the true ones.
Eigen::Matrix3d leastSquares(const PointPairs& pairs, std::size_t inliers) {
  std::vector<cv::Point2d> reference;
  std::vector<cv::Point2d> target;
  for (std::size_t i = 0; i < inliers; ++i) {
    reference.emplace_back(pairs.reference[i].x(), pairs.reference[i].y());
    target.emplace_back(pairs.target[i].x(), pairs.target[i].y());
  }
  Eigen::Matrix3d homography;
  cv::cv2eigen(cv::findHomography(reference, target, 0), homography);
  return homography;
}

TEST(ProsacHomography, IsNearlyAsExactAsLeastSquaresThatKnowsTheInliers) {
  ProsacHomography prosac;
  ProsacResult result;
  Numbers numbers(3);
  double ours = 0.0;
  double best = 0.0;
  for (int run = 0; run < 200; ++run) {
    Scene scene{400, 200, test::randomHomography(kSize, 0.15, numbers)};
    const PointPairs pairs = makePairs(scene, numbers);
    prosac.estimate(pairs, kSize, result);
    ASSERT_EQ(result.status, Status::ok);
    ours += cornerError(result.answer.homography, scene.homography, kSize);
    best += cornerError(leastSquares(pairs, scene.inliers), scene.homography, kSize);
  }
  // Least squares is optimal for Gaussian noise. The refinement assumes heavy tails, as for real
  // keypoints, and loses a few per cent here.
  EXPECT_LT(ours, 1.10 * best);
}

TEST(ProsacHomography, GivesTheSameBitsForTheSameSeed) {
  Numbers numbers(4);
  const PointPairs pairs =
      makePairs({500, 150, test::randomHomography(kSize, 0.15, numbers), Order::random}, numbers);
  ProsacResult first;
  ProsacHomography().estimate(pairs, kSize, first);
  ASSERT_EQ(first.status, Status::ok);
  ProsacHomography used;
  ProsacResult again;
  for (int run = 0; run < 3; ++run) {
    used.estimate(makePairs(Scene(), numbers), kSize, again);  // fills its buffers
    used.estimate(pairs, kSize, again);
    EXPECT_EQ(again.answer.homography, first.answer.homography);
    EXPECT_EQ(again.answer.covariance, first.answer.covariance);
    EXPECT_EQ(again.mask, first.mask);
    EXPECT_EQ(again.iterations, first.iterations);
    EXPECT_EQ(again.rmse, first.rmse);
  }
}

TEST(ProsacHomography, AllocatesNothingOnceItsBuffersHaveGrown) {
  Numbers numbers(5);
  Scene scene{600, 200, Eigen::Matrix3d::Identity(), Order::random};
  const PointPairs large = makePairs(scene, numbers);
  scene.pairs = 300;
  scene.inliers = 0;
  const PointPairs small = makePairs(scene, numbers);
  ProsacHomography prosac;
  ProsacResult result;
  prosac.estimate(large, kSize, result);
  prosac.estimate(small, kSize, result);
  const test::AllocationCounter counter;
  for (int run = 0; run < 5; ++run) {
    prosac.estimate(large, kSize, result);
    prosac.estimate(small, kSize, result);
  }
  EXPECT_EQ(counter.count(), 0U);
}

TEST(ProsacHomography, SaysWhichRuleEndedItAndHowFarItCame) {
  Numbers numbers(6);
  Scene scene{300, 270};
  ProsacHomography prosac;
  ProsacResult result;
  prosac.estimate(makePairs(scene, numbers), kSize, result);
  EXPECT_EQ(result.stop, ProsacStop::maximality);
  EXPECT_LT(result.iterations, 20);

  scene.inliers = 0;
  prosac.estimate(makePairs(scene, numbers), kSize, result);
  EXPECT_EQ(result.stop, ProsacStop::max_iterations);
  EXPECT_EQ(result.iterations, 2000);

  prosac.estimate(PointPairs(), kSize, result);
  EXPECT_EQ(result.stop, ProsacStop::not_run);
}

TEST(ProsacHomography, CovarianceAgreesWithMonteCarlo) {
  Numbers numbers(8);
  Scene scene{150, 150, test::randomHomography(kSize, 0.2, numbers), Order::good, 0.0};
  const PointPairs exact = makePairs(scene, numbers);
  using Vector8 = Eigen::Matrix<double, 8, 1>;
  using Matrix8 = Eigen::Matrix<double, 8, 8>;
  constexpr int kRuns = 2000;
  Matrix8 predicted = Matrix8::Zero();
  Matrix8 observed = Matrix8::Zero();
  ProsacHomography prosac;
  ProsacResult result;
  for (int run = 0; run < kRuns; ++run) {
    PointPairs noisy = exact;
    for (Eigen::Vector2d& p : noisy.target) {
      p.x() += 0.5 * numbers.normal();
      p.y() += 0.5 * numbers.normal();
    }
    prosac.estimate(noisy, kSize, result);
    ASSERT_EQ(result.status, Status::ok);
    Vector8 error;
    for (int i = 0; i < 8; ++i) {
      error[i] = result.answer.homography(i / 3, i % 3) - scene.homography(i / 3, i % 3);
    }
    predicted += result.answer.covariance / kRuns;
    observed += error * error.transpose() / kRuns;
  }
  EXPECT_TRUE(predicted.isApprox(predicted.transpose(), 1e-9));
  // Whitened by the predicted covariance, the observed one must be the identity. With 2000 runs the
  // standard error of each eigenvalue is about 5 %.
  const Eigen::LLT<Matrix8> llt(predicted);
  ASSERT_EQ(llt.info(), Eigen::Success);
  const Matrix8 half = llt.matrixL().solve(observed);
  const Matrix8 white = llt.matrixL().solve(half.transpose());
  const Vector8 eigenvalues = white.selfadjointView<Eigen::Lower>().eigenvalues();
  EXPECT_GT(eigenvalues.minCoeff(), 0.75);
  EXPECT_LT(eigenvalues.maxCoeff(), 1.30);
  EXPECT_NEAR(eigenvalues.mean(), 1.0, 0.10);
}

TEST(ProsacHomography, ScoresAnInitialHomographyFirst) {
  Numbers numbers(10);
  ProsacHomography prosac;
  ProsacResult from_scratch;
  ProsacResult result;
  int samples = 0;
  int samples_from_scratch = 0;
  for (int run = 0; run < 50; ++run) {
    Scene scene{400, 60, test::randomHomography(kSize, 0.15, numbers), Order::random};
    const PointPairs pairs = makePairs(scene, numbers);
    prosac.estimate(pairs, kSize, from_scratch);
    // A prediction is a few px off, and known up to a factor.
    Eigen::Matrix3d shift = Eigen::Matrix3d::Identity();
    shift(0, 2) = 1.0;
    shift(1, 2) = -1.0;
    prosac.estimate(pairs, kSize, -7.0 * shift * scene.homography, result);
    expectConsistent(pairs, result, 3.0);
    ASSERT_EQ(result.status, Status::ok);
    EXPECT_LT(cornerError(result.answer.homography, scene.homography, kSize), 8.0);
    samples += result.iterations;
    samples_from_scratch += from_scratch.iterations;
  }
  EXPECT_LE(samples, samples_from_scratch);
  // With too small a budget for sampling, only the prediction helps.
  ProsacOptions options;
  options.max_iterations = 10;
  int found_by_sampling = 0;
  int found = 0;
  for (int run = 0; run < 50; ++run) {
    Scene scene{400, 60, test::randomHomography(kSize, 0.15, numbers), Order::random};
    const PointPairs pairs = makePairs(scene, numbers);
    ProsacHomography hurried(options);
    hurried.estimate(pairs, kSize, result);
    found_by_sampling += result.status == Status::ok ? 1 : 0;
    hurried.estimate(pairs, kSize, scene.homography, result);
    EXPECT_EQ(result.iterations, 10);
    found += result.status == Status::ok ? 1 : 0;
  }
  EXPECT_LT(found_by_sampling, 10);
  EXPECT_EQ(found, 50);
}

TEST(ProsacHomography, IsNotMisledByAWrongInitialHomography) {
  Numbers numbers(11);
  ProsacHomography prosac;
  ProsacResult from_scratch;
  ProsacResult result;
  for (int run = 0; run < 100; ++run) {
    Scene scene{100, 50, test::randomHomography(kSize, 0.15, numbers)};
    const PointPairs pairs = makePairs(scene, numbers);
    prosac.estimate(pairs, kSize, test::randomHomography(kSize, 0.3, numbers), result);
    expectConsistent(pairs, result, 3.0);
    ASSERT_EQ(result.status, Status::ok);
    EXPECT_LT(cornerError(result.answer.homography, scene.homography, kSize), 8.0);
    // A prediction that is not the view of a plane is ignored.
    prosac.estimate(pairs, kSize, from_scratch);
    Eigen::Matrix3d mirrored = scene.homography;
    mirrored.col(0) *= -1.0;
    for (const Eigen::Matrix3d& none : {Eigen::Matrix3d(Eigen::Matrix3d::Zero()), mirrored,
                                        Eigen::Matrix3d(Eigen::Matrix3d::Ones())}) {
      prosac.estimate(pairs, kSize, none, result);
      EXPECT_EQ(result.answer.homography, from_scratch.answer.homography);
      EXPECT_EQ(result.iterations, from_scratch.iterations);
    }
  }
  const PointPairs pairs = makePairs(Scene(), numbers);
  const Eigen::Matrix3d bad = Eigen::Matrix3d::Constant(std::numeric_limits<double>::quiet_NaN());
  EXPECT_THROW(prosac.estimate(pairs, kSize, bad, result), std::invalid_argument);
  // A prediction does not make chance support acceptable.
  int accepted = 0;
  for (int run = 0; run < 2000; ++run) {
    prosac.estimate(makePairs({30, 0}, numbers), kSize, test::randomHomography(kSize, 0.1, numbers),
                    result);
    accepted += result.status == Status::ok ? 1 : 0;
  }
  EXPECT_LE(accepted, 2);
}

TEST(ProsacHomography, RefusesValuesThatAreNotFinite) {
  ProsacHomography prosac;
  ProsacResult result;
  Numbers numbers(9);
  const PointPairs good = makePairs(Scene(), numbers);
  for (double bad :
       {std::numeric_limits<double>::quiet_NaN(), std::numeric_limits<double>::infinity(),
        -std::numeric_limits<double>::infinity()}) {
    PointPairs pairs = good;
    pairs.reference[7].x() = bad;
    EXPECT_THROW(prosac.estimate(pairs, kSize, result), std::invalid_argument);
    pairs = good;
    pairs.target[7].y() = bad;
    EXPECT_THROW(prosac.estimate(pairs, kSize, result), std::invalid_argument);
    pairs = good;
    pairs.quality[7] = bad;
    EXPECT_THROW(prosac.estimate(pairs, kSize, result), std::invalid_argument);
  }
  PointPairs pairs = good;
  pairs.quality.pop_back();
  EXPECT_THROW(prosac.estimate(pairs, kSize, result), std::invalid_argument);
}

TEST(ProsacHomography, RefusesOptionsOutsideTheirRange) {
  const auto refuses = [](auto change) {
    ProsacOptions options;
    change(options);
    EXPECT_THROW(ProsacHomography{options}, std::invalid_argument);
  };
  refuses([](ProsacOptions& o) { o.max_error = 0.0; });
  refuses([](ProsacOptions& o) { o.max_error = std::numeric_limits<double>::quiet_NaN(); });
  refuses([](ProsacOptions& o) { o.max_iterations = 0; });
  refuses([](ProsacOptions& o) { o.confidence = 1.0; });
  refuses([](ProsacOptions& o) { o.confidence = 0.0; });
}

}  // namespace
}  // namespace ktgp_orb
