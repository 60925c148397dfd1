// The warps of ktgp_evaluate and their scores: the truth against an independent projection, the
// correlation against a textbook implementation, peers on a warp that all must find.
#include <gtest/gtest.h>

#include <Eigen/LU>
#include <Eigen/SVD>
#include <algorithm>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <limits>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <set>

#include "alignment_scene.h"
#include "evaluation/dataset.h"
#include "evaluation/output.h"
#include "evaluation/overlap.h"
#include "evaluation/pair_evaluation.h"
#include "evaluation/peers.h"
#include "evaluation/rendering.h"
#include "evaluation/warps.h"
#include "ktgp_orb/metrics.h"
#include "orb_test_images.h"

namespace ktgp_orb::evaluation {
namespace {

using test::apply;

/// A smooth pattern without a period.
double pattern(double x, double y) {
  return 128.0 + 45.0 * std::sin(0.11 * x + 0.02 * y) * std::cos(0.09 * y) +
         35.0 * std::sin(0.07 * y - 0.05 * x + 1e-4 * x * y);
}

cv::Mat drawPattern(const cv::Size& size, int type) {
  cv::Mat image(size, CV_32F);
  for (int y = 0; y < size.height; ++y) {
    for (int x = 0; x < size.width; ++x) {
      image.at<float>(y, x) = static_cast<float>(pattern(x, y));
    }
  }
  image.convertTo(image, type);
  return image;
}

/// Blobs and edges of all sizes, for every kind of keypoint.
cv::Mat drawScene(std::uint64_t seed, const cv::Size& size = {1000, 750}) {
  return test::textureImage(size, seed);
}

// --- rendering ---

TEST(Rendering, BilinearByHand) {
  cv::Mat image(2, 2, CV_32F);
  image.at<float>(0, 0) = 0.F;
  image.at<float>(0, 1) = 10.F;
  image.at<float>(1, 0) = 20.F;
  image.at<float>(1, 1) = 50.F;
  EXPECT_FLOAT_EQ(sampleBilinear(image, 0.0, 0.0), 0.F);
  EXPECT_FLOAT_EQ(sampleBilinear(image, 1.0, 1.0), 50.F);
  EXPECT_FLOAT_EQ(sampleBilinear(image, 0.25, 0.0), 2.5F);
  EXPECT_FLOAT_EQ(sampleBilinear(image, 0.5, 0.5), 20.F);
  EXPECT_TRUE(isInside({2, 2}, 1.0, 1.0));
  EXPECT_FALSE(isInside({2, 2}, 1.001, 0.0));
  EXPECT_FALSE(isInside({2, 2}, 0.0, -0.001));
}

TEST(Rendering, ShowsAnAnalyticPatternWhereTheHomographySays) {
  const cv::Mat source = drawPattern({1200, 900}, CV_32F);
  Eigen::Matrix3d source_from_view;
  source_from_view << 1.31, -0.22, 180.3, 0.17, 1.24, 60.7, 1e-4, -5e-5, 1.0;
  const cv::Mat view = renderView(source, source_from_view, {640, 480});
  double worst = 0.0;
  for (int y = 5; y < 475; ++y) {
    for (int x = 5; x < 635; ++x) {
      const Eigen::Vector2d p = apply(source_from_view, {double(x), double(y)});
      if (!isInside({1196, 896}, p.x() - 2.0, p.y() - 2.0)) continue;
      // The mean over a pixel differs from the value in its middle by the curvature, 0.4 grey here.
      worst = std::max(worst, std::abs(view.at<float>(y, x) - pattern(p.x(), p.y())));
    }
  }
  EXPECT_LT(worst, 1.0);
  EXPECT_GT(worst, 0.0);
}

TEST(Rendering, AveragesOverThePixel) {
  // A chequerboard of single pixels, shrunk five times: only its mean is left.
  cv::Mat source(1000, 1000, CV_32F);
  for (int y = 0; y < 1000; ++y) {
    for (int x = 0; x < 1000; ++x) source.at<float>(y, x) = (x + y) % 2 == 0 ? 0.F : 200.F;
  }
  const Eigen::Matrix3d shrink = Eigen::Vector3d(5.0, 5.0, 1.0).asDiagonal();
  const cv::Mat view = renderView(source, shrink, {190, 190})(cv::Rect(1, 1, 188, 188));
  double least = 0.0;
  double most = 0.0;
  cv::minMaxLoc(view, &least, &most);
  EXPECT_NEAR(least, 100.0, 12.0);
  EXPECT_NEAR(most, 100.0, 12.0);
}

TEST(Rendering, OutsideAndBeyondTheHorizonIsBlack) {
  const cv::Mat source(100, 100, CV_32F, cv::Scalar(200.0));
  Eigen::Matrix3d horizon = Eigen::Matrix3d::Identity();
  horizon(2, 0) = -1.0 / 50.0;  // w = 1 - x / 50
  const cv::Mat view = renderView(source, horizon, {100, 100});
  EXPECT_FLOAT_EQ(view.at<float>(10, 10), 200.F);
  EXPECT_FLOAT_EQ(view.at<float>(10, 45), 0.F) << "x = 450";
  EXPECT_FLOAT_EQ(view.at<float>(0, 80), 0.F) << "behind the camera";
}

// --- what is drawn ---

class Warps : public ::testing::TestWithParam<const char*> {};

/// Angle, zoom and shift of a homography at the image's middle, for tilts that are small or none.
TEST_P(Warps, StayWithinTheirLimitsAndReachThem) {
  const WarpLimits limits = *warpLimits(GetParam());
  const double cx = 0.5 * (kWarpWidth - 1);
  const double cy = 0.5 * (kWarpHeight - 1);
  double shift = 0.0, rotation = 0.0, smallest = 10.0, largest = 0.0, tilt = 0.0;
  for (int i = 0; i < 500; ++i) {
    const Eigen::Matrix3d h = drawWarp(limits, i, 7).homography;
    const Eigen::Vector2d middle = apply(h, {cx, cy}) - Eigen::Vector2d(cx, cy);
    shift = std::max({shift, std::abs(middle.x()), std::abs(middle.y())});
    Eigen::Matrix2d jacobian;
    jacobian << apply(h, {cx + 0.5, cy}) - apply(h, {cx - 0.5, cy}),
        apply(h, {cx, cy + 0.5}) - apply(h, {cx, cy - 0.5});
    const Eigen::JacobiSVD<Eigen::Matrix2d> svd(jacobian,
                                                Eigen::ComputeFullU | Eigen::ComputeFullV);
    // Tilt shortens one direction by its cosine, zoom scales both.
    const Eigen::Vector2d scales = svd.singularValues();
    tilt = std::max(tilt, std::acos(std::min(1.0, scales[1] / scales[0])) * 180.0 / M_PI);
    largest = std::max(largest, scales[0]);
    smallest = std::min(smallest, scales[0]);
    const Eigen::Matrix2d turn = svd.matrixU() * svd.matrixV().transpose();
    EXPECT_GT(turn.determinant(), 0.0) << "mirrored";
    rotation = std::max(rotation, std::abs(std::atan2(turn(1, 0), turn(0, 0))) * 180.0 / M_PI);
  }
  EXPECT_LE(shift, limits.shift + 1e-9);
  EXPECT_GT(shift, 0.97 * limits.shift);
  EXPECT_LE(rotation, limits.rotation + 1e-6);
  EXPECT_GT(rotation, 0.97 * limits.rotation);
  EXPECT_LE(tilt, limits.tilt + 0.01);
  EXPECT_GT(tilt, 0.95 * limits.tilt);
  EXPECT_NEAR(std::log(largest), std::log(limits.zoom), 0.05 * std::log(limits.zoom) + 1e-5);
  EXPECT_NEAR(std::log(smallest), -std::log(limits.zoom), 0.05 * std::log(limits.zoom) + 1e-5);
}

/// Position in warps_test's picture of 1000x750 px of pixel (0, 0) of the reference view, and the
/// distance of its pixels: the middle 85 %, as documented.
const cv::Size kPicture{1000, 750};
constexpr double kScale = 0.85 * 1000.0 / 640.0;

Eigen::Vector2d inPicture(const Eigen::Vector2d& reference) {
  return Eigen::Vector2d(499.5, 374.5) + kScale * (reference - Eigen::Vector2d(319.5, 239.5));
}

/// Shift of `view` (CV_32F) within a block against the pattern seen through `reference_from_view`:
/// one step of least squares with free gain and bias, which is exact for shifts far below the
/// pattern's waves.
std::optional<Eigen::Vector2d> shiftOfBlock(const cv::Mat& view,
                                            const Eigen::Matrix3d& reference_from_view,
                                            const cv::Rect& block) {
  const auto expected = [&](double x, double y) {
    const Eigen::Vector2d p = inPicture(apply(reference_from_view, {double(x), double(y)}));
    return pattern(p.x(), p.y());
  };
  Eigen::Matrix4d a = Eigen::Matrix4d::Zero();
  Eigen::Vector4d b = Eigen::Vector4d::Zero();
  for (int y = block.y; y < block.br().y; ++y) {
    for (int x = block.x; x < block.br().x; ++x) {
      const Eigen::Vector2d p = inPicture(apply(reference_from_view, {double(x), double(y)}));
      if (!isInside(kPicture - cv::Size(4, 4), p.x() - 2.0, p.y() - 2.0)) return std::nullopt;
      const double gx = 0.5 * (expected(x + 1, y) - expected(x - 1, y));
      const double gy = 0.5 * (expected(x, y + 1) - expected(x, y - 1));
      const Eigen::Vector4d row(-gx, -gy, expected(x, y), 1.0);
      a += row * row.transpose();
      b += row * view.at<float>(y, x);
    }
  }
  const Eigen::Vector4d solution = a.ldlt().solve(b);
  return Eigen::Vector2d(solution.head<2>() / solution[2]);
}

struct Offsets {
  double worst = 0.0;  ///< px
  int blocks = 0;
};

Offsets offsetsOf(const cv::Mat& image, const Eigen::Matrix3d& reference_from_view) {
  cv::Mat view;
  image.convertTo(view, CV_32F);
  Offsets offsets;
  for (int y = 0; y + 80 <= kWarpHeight; y += 80) {
    for (int x = 0; x + 80 <= kWarpWidth; x += 80) {
      const auto shift = shiftOfBlock(view, reference_from_view, {x, y, 80, 80});
      if (!shift) continue;
      offsets.worst = std::max(offsets.worst, shift->norm());
      ++offsets.blocks;
    }
  }
  return offsets;
}

TEST_P(Warps, TruthIsExact) {
  const cv::Mat picture = drawPattern(kPicture, CV_8U);
  const WarpLimits limits = *warpLimits(GetParam());
  int blocks = 0;
  for (int i = 0; i < 10; ++i) {
    const Warp warp = drawWarp(limits, i, 3);
    const WarpedImages images = renderWarp(picture, warp);
    EXPECT_LT(offsetsOf(images.reference, Eigen::Matrix3d::Identity()).worst, 0.02) << i;
    const Offsets offsets = offsetsOf(images.target, warp.homography.inverse());
    blocks += offsets.blocks;
    const double bound = warp.degradation ? 0.12 : 0.02;  // px; noise affects the measurement
    EXPECT_LT(offsets.worst, bound) << i << ", " << offsets.blocks << " blocks";
    RecordProperty("worst_" + std::to_string(i), std::to_string(offsets.worst));
  }
  EXPECT_GT(blocks, 80);
}

TEST_P(Warps, HalfOfThemAreDegraded) {
  const cv::Mat picture = drawPattern(kPicture, CV_8U);
  const WarpLimits limits = *warpLimits(GetParam());
  int degraded = 0;
  for (int i = 0; i < 48; ++i) degraded += drawWarp(limits, i, 1).degradation ? 1 : 0;
  EXPECT_EQ(degraded, 24);
  for (int i : {1, 3, 5}) {
    Warp warp = drawWarp(limits, i, 1);
    const cv::Mat seen = renderWarp(picture, warp).target;
    warp.degradation.reset();
    EXPECT_GT(cv::norm(seen, renderWarp(picture, warp).target, cv::NORM_L1) / seen.total(), 1.0);
  }
}

TEST_P(Warps, SameSeedSameWarp) {
  const cv::Mat picture = drawScene(1);
  const WarpLimits limits = *warpLimits(GetParam());
  for (int i : {0, 1}) {
    const Warp a = drawWarp(limits, i, 5);
    const Warp b = drawWarp(limits, i, 5);
    EXPECT_EQ(a.homography, b.homography);
    const WarpedImages first = renderWarp(picture, a);
    const WarpedImages second = renderWarp(picture, b);
    EXPECT_EQ(cv::norm(first.reference, second.reference, cv::NORM_INF), 0.0);
    EXPECT_EQ(cv::norm(first.target, second.target, cv::NORM_INF), 0.0);
    EXPECT_NE(a.homography, drawWarp(limits, i, 6).homography);
    EXPECT_NE(a.homography, drawWarp(limits, i + 2, 5).homography);
  }
}

INSTANTIATE_TEST_SUITE_P(All, Warps, ::testing::Values("small", "medium", "large"),
                         [](const auto& info) { return std::string(info.param); });

TEST(Warp, UnknownKindIsRefused) {
  EXPECT_FALSE(warpLimits("huge"));
  Dataset dataset;
  EXPECT_THROW(addWarps("huge", {"a.png"}, 1, 1, dataset), std::invalid_argument);
}

TEST(Warp, SmallOnesShowNothingButThePicture) {
  const cv::Mat white(750, 1000, CV_8U, cv::Scalar(200));
  for (int i = 0; i < 40; i += 2) {
    const WarpedImages images = renderWarp(white, drawWarp(*warpLimits("small"), i, 1));
    EXPECT_EQ(cv::countNonZero(images.target != 200), 0) << i;
  }
}

TEST(Warp, EveryPictureIsSeenCleanAndDegraded) {
  namespace fs = std::filesystem;
  const fs::path folder = fs::path(::testing::TempDir()) / "ktgp_orb_warps_test";
  fs::create_directories(folder);
  for (int pictures : {1, 2, 3, 18}) {
    std::vector<std::string> files;
    for (int i = 0; i < pictures; ++i) {
      files.push_back((folder / (std::to_string(i) + ".pgm")).string());
      std::ofstream(files.back()) << "P5 1 1 255 x";
    }
    Dataset dataset;
    addWarps("small", files, 2 * pictures, 1, dataset);
    std::set<std::pair<std::string, bool>> seen;
    for (const ImagePair& pair : dataset.pairs) {
      seen.insert({pair.reference, pair.warp->degradation.has_value()});
    }
    EXPECT_EQ(seen.size(), static_cast<std::size_t>(2 * pictures));
  }
  Dataset dataset;
  addWarps("small", {folder.string(), "nowhere.png"}, 36, 1, dataset);
  EXPECT_EQ(dataset.pairs.size(), 36u) << "a folder means its images";
  ASSERT_EQ(dataset.problems.size(), 1u);
  EXPECT_NE(dataset.problems[0].find("nowhere.png"), std::string::npos);
  fs::remove_all(folder);
}

// --- correlation of the overlap ---

/// The textbook version: two passes, means first; the target interpolated directly.
std::optional<double> naiveCorrelation(const cv::Mat& a, const cv::Mat& b,
                                       const Eigen::Matrix3d& h) {
  std::vector<std::pair<double, double>> values;
  for (int y = 0; y < a.rows; ++y) {
    for (int x = 0; x < a.cols; ++x) {
      const Eigen::Vector2d p = apply(h, {double(x), double(y)});
      if (!(p.x() >= 0 && p.y() >= 0 && p.x() <= b.cols - 1 && p.y() <= b.rows - 1)) continue;
      double value = 0.0;
      for (int v = 0; v < b.rows; ++v) {
        if (std::abs(v - p.y()) >= 1.0) continue;
        for (int u = 0; u < b.cols; ++u) {
          const double wx = 1.0 - std::abs(u - p.x());
          if (wx > 0.0) value += wx * (1.0 - std::abs(v - p.y())) * b.at<uchar>(v, u);
        }
      }
      values.emplace_back(a.at<uchar>(y, x), value);
    }
  }
  double mean_a = 0.0, mean_b = 0.0, aa = 0.0, bb = 0.0, ab = 0.0;
  for (const auto& [va, vb] : values) {
    mean_a += va / static_cast<double>(values.size());
    mean_b += vb / static_cast<double>(values.size());
  }
  for (const auto& [va, vb] : values) {
    aa += (va - mean_a) * (va - mean_a);
    bb += (vb - mean_b) * (vb - mean_b);
    ab += (va - mean_a) * (vb - mean_b);
  }
  return ab / std::sqrt(aa * bb);
}

TEST(OverlapCorrelation, EqualsTextbookFormula) {
  const cv::Mat a = drawScene(1, {80, 60});
  const cv::Mat b = drawScene(2, {90, 50});
  Eigen::Matrix3d h;
  h << 0.9, 0.1, -7.3, -0.05, 1.1, 4.6, 1e-3, -5e-4, 1.0;
  for (const cv::Mat& target : {a, b}) {
    EXPECT_NEAR(*overlapCorrelation(a, target, h), *naiveCorrelation(a, target, h), 1e-6);
    EXPECT_NEAR(*overlapCorrelation(a, target, -2.0 * h), *naiveCorrelation(a, target, h), 1e-6)
        << "H is known up to a factor";
  }
}

TEST(OverlapCorrelation, GainAndBiasDoNotChangeIt) {
  const cv::Mat a = drawScene(3, {320, 240});
  const Eigen::Matrix3d same = Eigen::Matrix3d::Identity();
  EXPECT_NEAR(*overlapCorrelation(a, a, same), 1.0, 1e-9);
  EXPECT_NEAR(*overlapCorrelation(a, 255 - a, same), -1.0, 1e-9);
  EXPECT_NEAR(*overlapCorrelation(a, a * 0.5 + 60, same), 1.0, 1e-3);
  EXPECT_LT(*overlapCorrelation(a, drawScene(4, {320, 240}), same), 0.3);
}

TEST(OverlapCorrelation, SaysNothingWhereThereIsNothingToCompare) {
  const cv::Mat a = drawScene(3, {320, 240});
  Eigen::Matrix3d away = Eigen::Matrix3d::Identity();
  away(0, 2) = 319.0;
  EXPECT_FALSE(overlapCorrelation(a, a, away));
  EXPECT_FALSE(
      overlapCorrelation(a, cv::Mat(240, 320, CV_8U, cv::Scalar(9)), Eigen::Matrix3d::Identity()));
  EXPECT_FALSE(overlapCorrelation(a, a, Eigen::Matrix3d::Zero()));
}

// --- methods ---

TEST(Peers, EachFindsASmallWarp) {
  const cv::Mat picture = drawScene(5);
  Features none;
  none.image_size = {kWarpWidth, kWarpHeight};
  std::set<std::string> names;
  for (const Method& method : peerMethods({})) {
    names.insert(method.name);
    if (!method.unavailable.empty()) continue;
    std::vector<double> errors;
    for (int i = 0; i < 4; ++i) {
      const Warp warp = drawWarp(*warpLimits("small"), i, 2);
      const WarpedImages images = renderWarp(picture, warp);
      std::vector<StepResult> steps;
      const Matching m = runMethod(method, {images.reference, images.target, none, none}, steps);
      ASSERT_TRUE(m.answer) << method.name << " " << i;
      errors.push_back(
          metrics::cornerError(m.answer->homography, warp.homography, {kWarpWidth, kWarpHeight}));
      EXPECT_TRUE(method.name == "ECC" || m.matches.size() > 100) << method.name;
    }
    std::sort(errors.begin(), errors.end());
    EXPECT_LT(errors[1], 0.3) << method.name;
    EXPECT_LT(errors.back(), 3.0) << method.name;
  }
  EXPECT_EQ(names, (std::set<std::string>{"SIFT", "AKAZE", "FLOW", "ECC"}));
}

TEST(Peers, SurviveImagesWithoutAnything) {
  const cv::Mat flat(480, 640, CV_8U, cv::Scalar(100));
  const cv::Mat picture = drawScene(6, {640, 480});
  Features none;
  none.image_size = {640, 480};
  for (const Method& method : peerMethods({})) {
    if (!method.unavailable.empty()) continue;
    for (const auto& [a, b] : {std::pair(flat, flat), {flat, picture}, {picture, flat}}) {
      std::vector<StepResult> steps;
      const Matching m = runMethod(method, {a, b, none, none}, steps);
      EXPECT_TRUE(m.estimated) << method.name;
    }
  }
}

// --- figures ---

PairScore scored(double corner_error, bool found, std::optional<double> zncc) {
  PairScore pair;
  pair.pair.set = "a";
  MethodScore m;
  m.method = "M";
  m.corner_error = corner_error;
  m.found = found;
  m.zncc = zncc;
  pair.methods.push_back(m);
  return pair;
}

TEST(Accuracy, ByHand) {
  constexpr double kNone = std::numeric_limits<double>::infinity();
  const SetSummary s =
      summarizeSets({scored(0.5, true, 0.9), scored(2.0, true, 0.7),
                     scored(25.0, true, std::nullopt), scored(kNone, false, std::nullopt)})
          .front();
  ASSERT_TRUE(s.accuracy);
  // Shares 0 at 0 px, 1/4 at 0.5 and 1/2 at 2, joined by straight lines: 0.0625 below the first,
  // 0.5625 below the second.
  EXPECT_DOUBLE_EQ(s.accuracy->auc[0], 0.0625 + 0.25 * 0.5);               // 1 px
  EXPECT_DOUBLE_EQ(s.accuracy->auc[1], (0.0625 + 0.5625 + 0.5 * 1) / 3);   // 3 px
  EXPECT_DOUBLE_EQ(s.accuracy->auc[2], (0.0625 + 0.5625 + 0.5 * 3) / 5);   // 5 px
  EXPECT_DOUBLE_EQ(s.accuracy->auc[3], (0.0625 + 0.5625 + 0.5 * 8) / 10);  // 10 px
  EXPECT_DOUBLE_EQ(s.accuracy->median_corner_error, 0.5 * (2.0 + 25.0));
  EXPECT_DOUBLE_EQ(s.accuracy->found, 0.75);
  EXPECT_DOUBLE_EQ(s.accuracy->wrong, 1.0 / 3);
  EXPECT_DOUBLE_EQ(*s.accuracy->zncc, 0.8);
}

TEST(Accuracy, NothingFoundIsNotWrong) {
  constexpr double kNone = std::numeric_limits<double>::infinity();
  const SetSummary s = summarizeSets({scored(kNone, false, std::nullopt)}).front();
  EXPECT_EQ(s.accuracy->found, 0.0);
  EXPECT_EQ(s.accuracy->wrong, 0.0);
  EXPECT_FALSE(s.accuracy->zncc);
  EXPECT_TRUE(std::isinf(s.accuracy->median_corner_error));
  EXPECT_NE(toTable({s}).find("none"), std::string::npos);
}

}  // namespace
}  // namespace ktgp_orb::evaluation
