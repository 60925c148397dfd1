// When ProsacHomography must refuse: chance, repetition, and data that do not determine H.

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <Eigen/LU>

#include "ktgp_orb/prosac_homography.h"
#include "synthetic_pairs.h"

namespace ktgp_orb {
namespace {

using test::cornerError;
using test::makePairs;
using test::Numbers;
using test::Order;
using test::Scene;

const cv::Size kSize(640, 480);

/// Pairs of the given reference points under a homography, with noise in the target.
class Verdict : public testing::Test {
 protected:
  void add(const Eigen::Vector2d& x, double sigma) {
    Eigen::Vector2d u = (truth_ * x.homogeneous()).hnormalized();
    u.x() += sigma * numbers_.normal();
    u.y() += sigma * numbers_.normal();
    pairs_.add(x, u, numbers_.uniform(0.0, 1.0));
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

TEST_F(Verdict, IsRightWhenTheOrderIsReversed) {
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

TEST_F(Verdict, IsNeverWrongOnATinyCluster) {
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

TEST_F(Verdict, RejectsAHorizonThatCrossesTheImage) {
  truth_ << 1, 0, 0, 0, 1, 0, 0, -1.0 / 400.0, 1;  // y = 400 goes to infinity
  while (pairs_.size() < 100) {
    const Eigen::Vector2d x = numbers_.pointIn(kSize);
    if (x.y() < 300.0) add(x, 0.0);
  }
  EXPECT_EQ(estimate(), Status::model_rejected);
  prosac_.estimate(pairs_, cv::Size(640, 301), result_);  // clear of a smaller image
  EXPECT_EQ(result_.status, Status::ok);
  prosac_.estimate(pairs_, cv::Size(), result_);  // and of the points
  EXPECT_EQ(result_.status, Status::ok);
}

}  // namespace
}  // namespace ktgp_orb
