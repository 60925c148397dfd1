// The exact mask is computed in the library, so the flags of the user's program do not change it.
#include "user_flags.h"

#include <gtest/gtest.h>

#include "synthetic_pairs.h"

namespace ktgp_orb {
namespace {

bool canFuse() {
#if defined(__x86_64__)
  return __builtin_cpu_supports("fma") != 0;
#else
  return true;
#endif
}

TEST(UserFlags, ChangeNoBitOfAnErrorOrARatio) {
  if (!canFuse()) GTEST_SKIP() << "this processor has no fused multiplication";
  const cv::Size size(640, 480);
  test::Numbers numbers(1);
  const Eigen::Matrix3d h = test::randomHomography(size, 0.1, numbers);
  const PointPairs pairs = test::makePairs({200, 100, h, test::Order::random, 1.0}, numbers);
  ProsacResult result;
  ProsacHomography().estimate(pairs, size, result);
  ASSERT_EQ(result.status, Status::ok);
  double sum = 0.0;
  for (std::size_t i = 0; i < pairs.size(); ++i) {
    const double error =
        test::errorInAUsersProgram(result.answer.homography, pairs.reference[i], pairs.target[i]);
    EXPECT_EQ(error,
              reprojectionError(result.answer.homography, pairs.reference[i], pairs.target[i]));
    if (result.mask[i] != 0) sum += error * error;
  }
  EXPECT_EQ(result.rmse, std::sqrt(sum / static_cast<double>(result.inliers)));
  for (int distance = 0; distance <= 256; ++distance) {
    const Correspondence c{0, 0, distance, 253, Level::knn, false};
    EXPECT_EQ(test::ratioInAUsersProgram(c), c.ratio());
  }
}

}  // namespace
}  // namespace ktgp_orb
