#include "ktgp_orb/prosac_homography.h"

#include <gtest/gtest.h>

#include <Eigen/Eigenvalues>
#include <Eigen/Geometry>
#include <limits>
#include <opencv2/calib3d.hpp>
#include <opencv2/core/eigen.hpp>
#include <stdexcept>
#include <string>

#include "allocation_counter.h"
#include "synthetic_pairs.h"

namespace ktgp_orb {
namespace {

using metrics::cornerError;
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
    const double error =
        reprojectionError(result.answer.homography, pairs.reference[i], pairs.target[i]);
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
  const Eigen::Matrix3d about_middle =
      test::translation(320, 240) *
      Eigen::AngleAxisd(0.6, Eigen::Vector3d::UnitZ()).toRotationMatrix() *
      test::translation(-320, -240);
  Eigen::Matrix3d perspective;
  perspective << 0.9, 0.1, 30, -0.2, 0.7, 120, -0.0004, -0.0009, 1;
  return {{"identity", Eigen::Matrix3d::Identity()},
          {"translation", test::translation(35.5, -20.25)},
          {"rotation", about_middle},
          {"zoom", test::cameraMatrix(1.7, 1.7, -220, -160)},
          {"shrink", test::cameraMatrix(0.4, 0.4, 190, 140)},
          {"perspective", perspective}};
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

TEST(ProsacHomography, NearlyAsExactAsOracleLeastSquares) {
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

TEST(ProsacHomography, ReportsTheStoppingRuleAndTheIterations) {
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
    prosac.estimate(pairs, kSize, -7.0 * test::translation(1, -1) * scene.homography, result);
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

TEST(ProsacHomography, WrongInitialHomographyDoesNotMislead) {
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
  constexpr double kInfinity = std::numeric_limits<double>::infinity();
  for (const double bad : {std::nan(""), kInfinity, -kInfinity}) {
    PointPairs of_reference = good, of_target = good, of_quality = good;
    of_reference.reference[7].x() = bad;
    of_target.target[7].y() = bad;
    of_quality.quality[7] = bad;
    for (const PointPairs& pairs : {of_reference, of_target, of_quality}) {
      EXPECT_THROW(prosac.estimate(pairs, kSize, result), std::invalid_argument) << bad;
    }
  }
  for (const double bad : {std::nan(""), kInfinity, -1.0}) {
    PointPairs of_rounding = good;
    of_rounding.rounding = bad;
    EXPECT_THROW(prosac.estimate(of_rounding, kSize, result), std::invalid_argument) << bad;
  }
  PointPairs pairs = good;
  pairs.quality.pop_back();
  EXPECT_THROW(prosac.estimate(pairs, kSize, result), std::invalid_argument);
}

// When it must refuse: chance, repetition, and data that do not determine H.

/// Pairs of the given reference points under a homography, with noise in the target.
class Verdict : public testing::Test {
 protected:
  void add(const Eigen::Vector2d& x, double sigma) {
    const Eigen::Vector2d noise(numbers_.normal(), numbers_.normal());
    pairs_.add(x, test::apply(truth_, x) + sigma * noise, numbers_.uniform(0.0, 1.0));
  }

  Status estimate() {
    prosac_.estimate(pairs_, kSize, result_);
    return result_.status;
  }

  bool isRight() { return cornerError(result_.answer.homography, truth_, kSize) < 20.0; }

  Numbers numbers_{11};
  Eigen::Matrix3d truth_ = test::randomHomography(kSize, 0.1, numbers_);
  PointPairs pairs_;
  ProsacHomography prosac_;
  ProsacResult result_;
};

TEST_F(Verdict, RejectsPureOutliers) {
  int accepted = 0;
  for (int run = 0; run < 10000; ++run) {
    ProsacOptions options;
    options.seed = static_cast<std::uint64_t>(run);
    ProsacHomography(options).estimate(
        makePairs({4 + static_cast<std::size_t>(numbers_.uniform(0.0, 997.0)), 0}, numbers_), kSize,
        result_);
    if (result_.status == Status::ok) ++accepted;
  }
  EXPECT_LE(accepted, 1);  // the documented one in 10 000
}

TEST_F(Verdict, RejectsPureOutliersWithWildOnesAmongThem) {
  // An outlier enlarges the area, so that the agreement of the others seems significant.
  int accepted = 0;
  for (int run = 0; run < 5000; ++run) {
    pairs_ = makePairs({12, 0}, numbers_);
    pairs_.target[0] = Eigen::Vector2d(1e5, 1e5);
    if (run % 2 == 0) pairs_.target[1] = Eigen::Vector2d(-1e5, 0.0);
    if (estimate() == Status::ok) ++accepted;
  }
  EXPECT_EQ(accepted, 0);
}

TEST_F(Verdict, RejectsPureOutliersWhenThereAreFew) {
  int accepted = 0;
  for (std::size_t n = 4; n <= 20; n += 2) {
    for (int run = 0; run < 2000; ++run) {
      pairs_ = makePairs({n, 0}, numbers_);
      if (estimate() == Status::ok) ++accepted;
    }
  }
  EXPECT_LE(accepted, 2);  // 18 000 of one in 10 000
}

TEST_F(Verdict, AcceptsFewPairsThatAllAgree) {
  int right = 0;
  for (int run = 0; run < 500; ++run) {
    pairs_ = makePairs({8, 8, truth_}, numbers_);
    if (estimate() == Status::ok && isRight()) ++right;
  }
  EXPECT_GE(right, 450);
}

TEST_F(Verdict, ReversedOrderIsRight) {
  for (std::size_t n : {100, 300, 1000}) {
    int right = 0;
    int wrong = 0;
    for (std::uint64_t seed = 0; seed < 500; ++seed) {
      Scene scene{n, n * 3 / 10, Eigen::Matrix3d::Identity(), Order::reversed};
      truth_ = scene.homography = test::randomHomography(kSize, 0.15, numbers_);
      ProsacOptions options;
      options.seed = seed;
      ProsacHomography(options).estimate(makePairs(scene, numbers_), kSize, result_);
      if (result_.status != Status::ok) continue;
      ++(isRight() ? right : wrong);
    }
    EXPECT_EQ(wrong, 0) << n;
    EXPECT_GE(right, 495) << n;
  }
}

TEST_F(Verdict, ManyToOneDoesNotProveAnything) {
  const auto many = [&](bool one_target, bool one_reference) {
    pairs_.clear();
    const Eigen::Vector2d x = numbers_.pointIn(kSize);
    const Eigen::Vector2d u = numbers_.pointIn(kSize);
    for (int i = 0; i < 100; ++i) {
      pairs_.reference.push_back(one_reference ? x : numbers_.pointIn(kSize));
      pairs_.target.push_back(one_target ? u : numbers_.pointIn(kSize));
      pairs_.quality.push_back(0.5);
    }
    return estimate();
  };
  for (int run = 0; run < 50; ++run) {
    EXPECT_NE(many(true, false), Status::ok);
    EXPECT_NE(many(false, true), Status::ok);
  }
  EXPECT_EQ(many(true, true), Status::no_model);
}

TEST_F(Verdict, RepeatedPairsCountOnce) {
  const std::vector<Eigen::Vector2d> places{{50, 60}, {600, 40}, {590, 450}, {30, 430}};
  for (double jitter : {0.0, 0.5}) {  // the same keypoint, or the same corner in another octave
    pairs_.clear();
    for (int i = 0; i < 100; ++i) add(places[static_cast<std::size_t>(i % 4)], jitter);
    EXPECT_EQ(estimate(), Status::model_rejected) << jitter;
  }
  pairs_.clear();
  for (int i = 0; i < 40; ++i) {
    const Eigen::Vector2d x = numbers_.pointIn(kSize);
    add(x, 0.0);
    add(x, 0.0);
  }
  ASSERT_EQ(estimate(), Status::ok);
  EXPECT_EQ(result_.inliers, 80u);
}

TEST_F(Verdict, FindsPointsOnTwoLines) {
  for (int run = 0; run < 100; ++run) {
    pairs_.clear();
    for (int i = 0; i < 40; ++i) {
      add({numbers_.uniform(0, 639), 100.0}, 0.3);
      add({numbers_.uniform(0, 639), 400.0}, 0.3);
    }
    ASSERT_EQ(estimate(), Status::ok);
    EXPECT_TRUE(isRight());
  }
}

TEST_F(Verdict, NeverTrustsASinglePointBesideALine) {
  for (double sigma : {0.0, 0.3, 1.0}) {
    for (int others : {0, 1}) {
      for (int run = 0; run < 100; ++run) {
        pairs_.clear();
        for (int i = 0; i < 60; ++i) {
          const double x = numbers_.uniform(0, 639);
          add({x, 80.0 + 0.5 * x}, sigma);
        }
        for (int i = 0; i < others; ++i) add({100.0, 400.0}, sigma);
        EXPECT_NE(estimate(), Status::ok) << sigma << ' ' << others;
      }
    }
  }
}

TEST_F(Verdict, TinyClusterIsRejected) {
  for (double size : {1.0, 5.0, 20.0, 60.0}) {
    for (int run = 0; run < 200; ++run) {
      pairs_.clear();
      for (int i = 0; i < 60; ++i) {
        add({300.0 + numbers_.uniform(0, size), 200.0 + numbers_.uniform(0, size)}, 0.5);
      }
      EXPECT_TRUE(estimate() != Status::ok || isRight()) << size;
    }
  }
}

TEST_F(Verdict, RejectsAMirrorImage) {
  truth_ << -1, 0, 639, 0, 1, 0, 0, 0, 1;
  for (int i = 0; i < 100; ++i) add(numbers_.pointIn(kSize), 0.0);
  EXPECT_NE(estimate(), Status::ok);
}

// Six exact pairs have an NFA of about 1e-8: enough where the plane is seen whole, too few where
// the horizon crosses the reference.
TEST_F(Verdict, AHorizonInTheImageNeedsMoreEvidence) {
  truth_ << 1, 0, 0, 0, 1, 0, 0, -1.0 / 400.0, 1;  // y = 400 goes to infinity
  const auto grow = [&](std::size_t count) {
    while (pairs_.size() < count) {
      const Eigen::Vector2d x = numbers_.pointIn(kSize);
      if (x.y() < 300.0) add(x, 0.0);
    }
  };
  grow(6);
  EXPECT_EQ(estimate(), Status::model_rejected);
  prosac_.estimate(pairs_, cv::Size(640, 301), result_);  // clear of a smaller image
  EXPECT_EQ(result_.status, Status::ok);
  prosac_.estimate(pairs_, cv::Size(), result_);  // and of the points
  EXPECT_EQ(result_.status, Status::ok);
  grow(100);
  EXPECT_EQ(estimate(), Status::ok);
  EXPECT_EQ(result_.inliers, 100);
}

// The covariance must describe the error of the homography, also for few pairs.

/// Number of inliers, and bounds for the mean of the normalised squared error. For normal errors
/// and a known covariance it is 8. If the scale of the errors is estimated from the same few pairs,
/// it has heavy tails, which the bounds allow for.
struct Case {
  std::size_t inliers;
  double lowest;
  double highest;
};

class Covariance : public testing::TestWithParam<Case> {
 protected:
  /// The mean over 3000 scenes with this number of outliers per inlier is within the bounds.
  void check(double outliers_per_inlier) {
    const auto& [inliers, lowest, highest] = GetParam();
    Numbers numbers(21);
    ProsacHomography prosac;
    ProsacResult result;
    double sum = 0.0;
    int found = 0;
    for (int run = 0; run < 3000; ++run) {
      const Scene scene{
          inliers + static_cast<std::size_t>(outliers_per_inlier * static_cast<double>(inliers)),
          inliers, test::randomHomography(kSize, 0.15, numbers)};
      prosac.estimate(makePairs(scene, numbers), kSize, result);
      if (result.status != Status::ok) continue;
      sum += test::squaredDeviation(result.answer, scene.homography);
      ++found;
    }
    EXPECT_GT(found, 2600);
    RecordProperty("normalised_squared_error", std::to_string(sum / found));
    EXPECT_GT(sum / found, lowest);
    EXPECT_LT(sum / found, highest);
  }
};

TEST_P(Covariance, MatchesErrors) {
  check(0.0);
}

TEST_P(Covariance, MatchesErrorsAmongOutliers) {
  check(0.5);
}

INSTANTIATE_TEST_SUITE_P(FewAndMany, Covariance,
                         testing::Values(Case{8, 7.0, 11.5}, Case{12, 7.0, 10.0},
                                         Case{20, 7.2, 9.0}, Case{50, 7.3, 8.7},
                                         Case{200, 7.5, 8.5}),
                         [](const auto& info) { return std::to_string(info.param.inliers); });

}  // namespace
}  // namespace ktgp_orb
