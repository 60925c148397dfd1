// The covariance must describe the error of the homography, also for few pairs.

#include <gtest/gtest.h>

#include <algorithm>

#include "ktgp_orb/prosac_homography.h"
#include "synthetic_pairs.h"

namespace ktgp_orb {
namespace {

const cv::Size kSize(640, 480);

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
  /// Mean over 3000 scenes with this number of outliers per inlier.
  double measure(double outliers_per_inlier) {
    const std::size_t inliers = GetParam().inliers;
    test::Numbers numbers(21);
    ProsacHomography prosac;
    ProsacResult result;
    double sum = 0.0;
    int found = 0;
    for (int run = 0; run < 3000; ++run) {
      test::Scene scene{
          inliers + static_cast<std::size_t>(outliers_per_inlier * static_cast<double>(inliers)),
          inliers, test::randomHomography(kSize, 0.15, numbers)};
      prosac.estimate(test::makePairs(scene, numbers), kSize, result);
      if (result.status != Status::ok) continue;
      sum += test::squaredDeviation(result.answer, scene.homography);
      ++found;
    }
    EXPECT_GT(found, 2600);
    return sum / found;
  }
};

TEST_P(Covariance, IsAsLargeAsTheErrors) {
  const double measured = measure(0.0);
  RecordProperty("normalised_squared_error", std::to_string(measured));
  EXPECT_GT(measured, GetParam().lowest);
  EXPECT_LT(measured, GetParam().highest);
}

TEST_P(Covariance, IsAsLargeAsTheErrorsAmongOutliers) {
  const double measured = measure(0.5);
  RecordProperty("normalised_squared_error", std::to_string(measured));
  EXPECT_GT(measured, GetParam().lowest);
  EXPECT_LT(measured, GetParam().highest);
}

INSTANTIATE_TEST_SUITE_P(FewAndMany, Covariance,
                         testing::Values(Case{8, 7.0, 11.5}, Case{12, 7.0, 10.0},
                                         Case{20, 7.2, 9.0}, Case{50, 7.3, 8.7},
                                         Case{200, 7.5, 8.5}),
                         [](const auto& info) { return std::to_string(info.param.inliers); });

}  // namespace
}  // namespace ktgp_orb
