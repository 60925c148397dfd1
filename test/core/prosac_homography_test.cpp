#include "ktgp_orb/prosac_homography.h"

#include <gtest/gtest.h>

#include <limits>
#include <stdexcept>

#include "synthetic_pairs.h"

namespace ktgp_orb {
namespace {

using test::cornerError;
using test::makePairs;
using test::Numbers;
using test::Order;
using test::Scene;

const cv::Size kSize(640, 480);

/// The mask must be the threshold test on the returned H, and the counts those of the mask.
void expectConsistent(const PointPairs& pairs, const ProsacResult& result, double threshold) {
  ASSERT_EQ(result.mask.size(), pairs.size());
  std::size_t inliers = 0;
  double sum = 0.0;
  for (std::size_t i = 0; i < pairs.size(); ++i) {
    const double error =
        (((result.homography * pairs.reference[i].homogeneous()).hnormalized()) - pairs.target[i])
            .norm();
    const bool inlier = result.status == Status::ok && error < threshold;
    ASSERT_EQ(result.mask[i], inlier ? 1 : 0) << "pair " << i << " error " << error;
    if (!inlier) continue;
    ++inliers;
    sum += error * error;
  }
  EXPECT_EQ(result.inliers, inliers);
  EXPECT_NEAR(result.rmse, inliers > 0 ? std::sqrt(sum / double(inliers)) : 0.0, 1e-9);
}

TEST(ProsacHomography, FindsKnownHomographies) {
  Numbers numbers(1);
  ProsacHomography prosac;
  ProsacResult result;
  for (int run = 0; run < 200; ++run) {
    Scene scene;
    scene.pairs = 200;
    scene.inliers = 100;
    scene.homography = test::randomHomography(kSize, 0.2, numbers);
    const PointPairs pairs = makePairs(scene, numbers);
    prosac.estimate(pairs, kSize, result);
    ASSERT_EQ(result.status, Status::ok) << run;
    EXPECT_LT(cornerError(result.homography, scene.homography, kSize), 3.0) << run;
    expectConsistent(pairs, result, 3.0);
  }
}

TEST(ProsacHomography, IsExactOnExactPairs) {
  Numbers numbers(2);
  ProsacHomography prosac;
  ProsacResult result;
  for (std::size_t n = 0; n <= 200; ++n) {
    Scene scene;
    scene.pairs = scene.inliers = n;
    scene.sigma = 0.0;
    scene.homography = test::randomHomography(kSize, 0.2, numbers);
    const PointPairs pairs = makePairs(scene, numbers);
    prosac.estimate(pairs, kSize, result);
    expectConsistent(pairs, result, 3.0);
    if (n < 4) {
      EXPECT_EQ(result.status, Status::too_few_matches);
    } else if (n == 4) {
      EXPECT_EQ(result.status, Status::no_model);
    } else if (n >= 8) {
      ASSERT_EQ(result.status, Status::ok) << n;
    }
    if (result.status == Status::ok) {
      EXPECT_LT(cornerError(result.homography, scene.homography, kSize), 1e-6) << n;
    }
  }
}

TEST(ProsacHomography, RefusesValuesThatAreNotFinite) {
  ProsacHomography prosac;
  ProsacResult result;
  Numbers numbers(3);
  Scene scene;
  const PointPairs good = makePairs(scene, numbers);
  for (double bad :
       {std::numeric_limits<double>::quiet_NaN(), std::numeric_limits<double>::infinity()}) {
    PointPairs pairs = good;
    pairs.reference[7].x() = bad;
    EXPECT_THROW(prosac.estimate(pairs, kSize, result), std::invalid_argument);
    pairs = good;
    pairs.target[7].y() = -bad;
    EXPECT_THROW(prosac.estimate(pairs, kSize, result), std::invalid_argument);
    pairs = good;
    pairs.quality[7] = bad;
    EXPECT_THROW(prosac.estimate(pairs, kSize, result), std::invalid_argument);
  }
  PointPairs pairs = good;
  pairs.quality.pop_back();
  EXPECT_THROW(prosac.estimate(pairs, kSize, result), std::invalid_argument);
}

}  // namespace
}  // namespace ktgp_orb
