// Removal of lens distortion from points: compared with the forward models, implemented here again,
// and with a plane seen through a lens.

#include "ktgp_orb/lens.h"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <limits>
#include <opencv2/imgproc.hpp>

#include "ktgp_orb/sequence_matcher.h"
#include "orb_test_images.h"
#include "synthetic_pairs.h"

namespace ktgp_orb {
namespace {

constexpr int kWidth = 320;
constexpr int kHeight = 240;

LensCalibration wide(LensModel model, const std::vector<double>& distortion) {
  LensCalibration c;
  c.model = model;
  c.image_size = {kWidth, kHeight};
  c.camera = {250.0, 0.0, 162.0, 0.0, 255.0, 118.0, 0.0, 0.0, 1.0};
  c.distortion = distortion;
  c.rectified_camera = {200.0, 0.0, 160.0, 0.0, 200.0, 120.0, 0.0, 0.0, 1.0};
  return c;
}

LensCalibration barrel() {
  return wide(LensModel::radial_tangential, {-0.30, 0.0, 0.0, 0.0, 0.0});
}

/// The ray (x, y, 1) after the lens and before K, by the definition of the models.
cv::Point2d bent(const LensCalibration& c, double x, double y) {
  const std::vector<double>& d = c.distortion;
  const double r2 = x * x + y * y;
  if (c.model == LensModel::equidistant) {
    const double r = std::sqrt(r2);
    const double t = std::atan(r);
    const double t2 = t * t;
    const double bent = t * (1 + t2 * (d[0] + t2 * (d[1] + t2 * (d[2] + t2 * d[3]))));
    return r > 0 ? cv::Point2d(x, y) * (bent / r) : cv::Point2d(x, y);
  }
  const double radial = 1 + r2 * (d[0] + r2 * (d[1] + r2 * d[4]));
  return {x * radial + 2 * d[2] * x * y + d[3] * (r2 + 2 * x * x),
          y * radial + d[2] * (r2 + 2 * y * y) + 2 * d[3] * x * y};
}

cv::Point2d seen(const cv::Matx33d& camera, const cv::Point2d& p) {
  return {camera(0, 0) * p.x + camera(0, 2), camera(1, 1) * p.y + camera(1, 2)};
}

TEST(Lens, UndoesBothModels) {
  for (const LensCalibration& calibration :
       {wide(LensModel::radial_tangential, {-0.30, 0.09, 0.002, -0.001, -0.01}),
        wide(LensModel::equidistant, {0.05, -0.02, 0.01, -0.003})}) {
    std::vector<cv::KeyPoint> keypoints;
    std::vector<cv::Point2d> expected;
    for (double y = -0.45; y <= 0.451; y += 0.05) {
      for (double x = -0.6; x <= 0.601; x += 0.05) {
        const cv::Point2f at(seen(calibration.camera, bent(calibration, x, y)));
        keypoints.emplace_back(at, 31.F);
        expected.push_back(seen(calibration.rectified_camera, {x, y}));
      }
    }
    Lens(calibration).rectify(keypoints);
    for (std::size_t i = 0; i < expected.size(); ++i) {
      EXPECT_LT(cv::norm(cv::Point2d(keypoints[i].pt) - expected[i]), 1e-3) << expected[i];
    }
  }
}

/// A fisheye of 200 degrees.
LensCalibration fisheye() {
  LensCalibration c;
  c.model = LensModel::equidistant;
  c.image_size = {400, 400};
  c.camera = {85.0, 0.0, 199.5, 0.0, 85.0, 199.5, 0.0, 0.0, 1.0};
  c.distortion = {0.0, 0.0, 0.0, 0.0};
  c.rectified_camera = c.camera;
  return c;
}

TEST(Lens, GivesNoPlaceBeyondItsRange) {
  std::vector<cv::KeyPoint> keypoints;
  for (int degrees = 5; degrees <= 100; degrees += 5) {
    keypoints.emplace_back(
        cv::Point2f(static_cast<float>(199.5 + 85.0 * degrees * M_PI / 180.0), 199.5F), 31.F);
  }
  Lens(fisheye()).rectify(keypoints);
  for (std::size_t i = 0; i < keypoints.size(); ++i) {
    const double angle = 5.0 * static_cast<double>(i + 1) * M_PI / 180.0;
    if (i < 11) {
      EXPECT_NEAR(keypoints[i].pt.x, 199.5 + 85.0 * std::tan(angle), 1e-2) << i;
    } else if (i > 11) {
      EXPECT_TRUE(std::isnan(keypoints[i].pt.x) && std::isnan(keypoints[i].pt.y)) << i;
    }
  }
}

// r (1 - 0.3 r²) has its largest value, .7, at r = 1.05: no ray leads to the pixels beyond, and two
// rays to those within.
TEST(Lens, GivesNoPlaceWhereTheModelBendsTwoRaysToOnePixel) {
  const LensCalibration c = barrel();
  std::vector<cv::KeyPoint> keypoints;
  for (const double r : {0.5, 0.9, 1.5})
    keypoints.emplace_back(cv::Point2f(seen(c.camera, bent(c, r, 0.0))), 31.F);
  keypoints.emplace_back(162.F + 250.F * 0.75F, 118.F, 31.F);
  Lens(c).rectify(keypoints);
  EXPECT_NEAR(keypoints[0].pt.x, seen(c.rectified_camera, {0.5, 0.0}).x, 1e-2);
  EXPECT_NEAR(keypoints[1].pt.x, seen(c.rectified_camera, {0.9, 0.0}).x, 1e-2);
  EXPECT_LT(keypoints[2].pt.x, seen(c.rectified_camera, {1.1, 0.0}).x) << "the nearer of two rays";
  EXPECT_TRUE(std::isnan(keypoints[3].pt.x));
}

TEST(Lens, FeaturesBeyondItsRangeAreLeftOut) {
  Frame frame;
  frame.image = test::textureImage({400, 400}, 5);
  frame.lens = std::make_shared<Lens>(fisheye());
  OrbExtractor extractor;
  extractFeatures(extractor, frame);
  Features all;
  extractor.extract(frame.image, all);
  EXPECT_LT(frame.features.size(), all.size());
  EXPECT_GT(frame.features.size(), all.size() / 6);  // a fifth of where keypoints may be
  EXPECT_EQ(static_cast<std::size_t>(frame.features.descriptors.rows), frame.features.size());
  for (const cv::KeyPoint& k : frame.features.keypoints) {
    EXPECT_LT(std::hypot(k.pt.x - 199.5, k.pt.y - 199.5), 85.0 * std::tan(60.1 * M_PI / 180.0));
  }
}

TEST(Lens, RefusesInvalidCalibrations) {
  constexpr double kInfinity = std::numeric_limits<double>::infinity();
  const std::vector<std::function<void(LensCalibration&)>> changes{
      [](auto& c) { c.camera(0, 0) = 0.0; }, [](auto& c) { c.rectified_camera(1, 1) = kInfinity; },
      [](auto& c) {
        c.distortion = {0.1, 0.2, 0.3};
      },
      [](auto& c) {
        c.distortion = {0.1, 0.2, 0.3, kInfinity};
      },
      [](auto& c) { c.model = LensModel::equidistant; }};
  for (std::size_t i = 0; i < changes.size(); ++i) {
    LensCalibration calibration = barrel();
    changes[i](calibration);
    EXPECT_THROW(Lens{calibration}, std::invalid_argument) << i;
  }
}

TEST(Lens, RefusesADistortionThatCannotBeUndone) {
  for (const LensModel model : {LensModel::radial_tangential, LensModel::equidistant}) {
    for (const double huge : {1e9, -1e9, 1e200}) {
      EXPECT_THROW(Lens{wide(model, {huge, huge, huge, huge})}, std::invalid_argument) << huge;
    }
  }
}

/// Blocks of several sizes: corners that look alike from different distances.
cv::Mat blocks(const cv::Size& size) {
  cv::Mat sum = cv::Mat::zeros(size, CV_32F);
  for (const int cell : {8, 16, 32}) {
    const cv::Size coarse(size.width / cell + 1, size.height / cell + 1);
    cv::Mat layer;
    cv::resize(test::noiseImage(coarse, static_cast<std::uint64_t>(cell)), layer, {}, cell, cell,
               cv::INTER_NEAREST);
    cv::accumulate(layer(cv::Rect({0, 0}, size)), sum);
  }
  cv::Mat image;
  sum.convertTo(image, CV_8U, 1.0 / 3.0);
  return image;
}

/// The camera's view of the world through a lens with one coefficient, moved by (x, y) px of the
/// rectified image.
cv::Mat rawView(const LensCalibration& c, double x, double y) {
  static const cv::Mat world = blocks({1200, 900});
  cv::Mat map(kHeight, kWidth, CV_32FC2);
  for (int row = 0; row < kHeight; ++row) {
    for (int column = 0; column < kWidth; ++column) {
      const double u = (column - c.camera(0, 2)) / c.camera(0, 0);
      const double v = (row - c.camera(1, 2)) / c.camera(1, 1);
      const double bent = std::hypot(u, v);
      double r = bent;
      for (int i = 0; i < 20; ++i) {  // Newton: r + k r^3 = bent
        r -= (r + c.distortion[0] * r * r * r - bent) / (1 + 3 * c.distortion[0] * r * r);
      }
      const double s = bent > 0 ? r / bent : 1.0;
      const cv::Point2d ideal = seen(c.rectified_camera, {s * u, s * v});
      map.at<cv::Point2f>(row, column) = cv::Point2f(float(ideal.x + x), float(ideal.y + y));
    }
  }
  cv::Mat image;
  cv::remap(world, image, map, cv::noArray(), cv::INTER_LINEAR);
  return image;
}

/// Matches of two views 40 px apart.
SequenceMatch matched(const LensCalibration& calibration, const LensConstPtr& lens) {
  static SequenceMatcher matcher;
  matcher.restart();
  for (int i = 0; i < 2; ++i) {
    const FramePtr frame = matcher.newFrame();
    frame->image = rawView(calibration, 300.0 + 40.0 * i, 300.0 + 20.0 * i);
    frame->stamp = 1000 + i;
    frame->lens = lens;
    if (i == 1) return matcher.match(frame);
    matcher.match(frame);
  }
  return {};
}

// A driver may send its calibration with every frame: only a change of its content counts.
TEST(Lens, AnEqualLensIsTheSameAndAnotherStartsASequence) {
  SequenceMatcher matcher;
  LensCalibration calibration = barrel();
  std::int64_t stamp = 0;
  const auto reason = [&](const LensConstPtr& lens) {
    const FramePtr frame = matcher.newFrame();
    frame->stamp = ++stamp;
    frame->image = rawView(barrel(), 300.0 + static_cast<double>(stamp), 300.0);
    frame->lens = lens;
    return matcher.match(frame).no_reference;
  };
  const auto newLens = [&] { return std::make_shared<const Lens>(calibration); };
  EXPECT_EQ(reason(newLens()), NoReference::first_frame);
  EXPECT_EQ(reason(newLens()), NoReference::none);
  calibration.distortion[0] = -0.29;
  EXPECT_EQ(reason(newLens()), NoReference::lens_changed);
  EXPECT_EQ(reason(newLens()), NoReference::none);
  EXPECT_EQ(reason(nullptr), NoReference::lens_changed);
  EXPECT_EQ(reason(nullptr), NoReference::none);
  EXPECT_EQ(reason(newLens()), NoReference::lens_changed);
}

TEST(Lens, HomographyIsRightInRectifiedPixels) {
  const LensCalibration calibration = barrel();
  const SequenceMatch raw = matched(calibration, nullptr);
  const auto lens = std::make_shared<const Lens>(calibration);
  const SequenceMatch rectified = matched(calibration, lens);
  ASSERT_EQ(rectified.match.status, Status::ok);
  const auto errorOf = [](const SequenceMatch& match) {
    return test::cornerError(match.match.answer.homography, test::translation(-40.0, -20.0),
                             {kWidth, kHeight});
  };
  const double error = errorOf(rectified);
  const double raw_error = errorOf(raw);
  RecordProperty("error", std::to_string(error));
  std::printf("corner error %.3f px, %zu inliers; raw %.3f px, %zu inliers\n", error,
              rectified.match.inliers, raw_error, raw.match.inliers);
  EXPECT_LT(error, 0.7);
  EXPECT_GT(raw_error, 3.0) << "else the test shows nothing";
  EXPECT_EQ(rectified.match.alignment.status, AlignmentStatus::no_images)
      << "the image is not where the points are";
}

TEST(Lens, AnImageIsRectifiedAsItsPointsAre) {
  const LensCalibration calibration = barrel();
  cv::Mat dot = cv::Mat::zeros(kHeight, kWidth, CV_8UC1);
  cv::circle(dot, {60, 50}, 3, cv::Scalar(255), cv::FILLED);
  std::vector<cv::KeyPoint> keypoint{cv::KeyPoint(60.F, 50.F, 31.F)};
  const Lens lens(calibration);
  lens.rectify(keypoint);
  cv::Mat rectified;
  lens.rectify(dot, rectified);
  const cv::Moments m = cv::moments(rectified);
  EXPECT_NEAR(m.m10 / m.m00, keypoint[0].pt.x, 0.3);
  EXPECT_NEAR(m.m01 / m.m00, keypoint[0].pt.y, 0.3);
  EXPECT_GT(cv::norm(keypoint[0].pt - cv::Point2f(60.F, 50.F)), 5.0);
}

TEST(Mask, KeypointsAreSoughtWhereItIsNotZero) {
  SequenceMatcher matcher;
  const FramePtr frame = matcher.newFrame();
  frame->image = test::textureImage(cv::Size(kWidth, kHeight), 1);
  frame->mask = cv::Mat::zeros(kHeight, kWidth, CV_8UC1);
  frame->mask(cv::Rect(40, 60, 200, 120)).setTo(255);
  matcher.match(frame);
  ASSERT_GT(frame->features.size(), 100U);
  for (const cv::KeyPoint& k : frame->features.keypoints) {
    EXPECT_TRUE(cv::Rect2f(39.F, 59.F, 202.F, 122.F).contains(k.pt)) << k.pt;
  }
}

}  // namespace
}  // namespace ktgp_orb
