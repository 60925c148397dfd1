// Properties that a viewer must see, measured in the pixels of the drawings.
#include "ktgp_orb/overlay.h"

#include <gtest/gtest.h>

#include <Eigen/Core>
#include <algorithm>
#include <limits>
#include <opencv2/imgproc.hpp>
#include <stdexcept>
#include <tuple>

#include "orb_test_images.h"
#include "synthetic_pairs.h"

namespace ktgp_orb {
namespace {

const cv::Vec3b kFinal(66, 228, 240);
const cv::Vec3b kRemovedByGms(233, 180, 86);
const cv::Vec3b kOfEpipolar(115, 158, 0);

bool isNear(const cv::Vec3b& a, const cv::Vec3b& b) {
  return cv::norm(a, b, cv::NORM_INF) <= 40.0;
}

int countColour(const cv::Mat& canvas, const cv::Vec3b& colour) {
  const cv::Mat_<cv::Vec3b> pixels = canvas;
  return static_cast<int>(std::count_if(
      pixels.begin(), pixels.end(), [&](const cv::Vec3b& pixel) { return isNear(pixel, colour); }));
}

/// A textured scene that moves by (20, 10) px, with matches on a grid; every fourth was removed by
/// GMS, the others are final.
struct Scene {
  explicit Scene(const cv::Size& size, int spacing = 40) {
    cv::Mat noise(size.height + 40, size.width + 40, CV_8UC1);
    cv::RNG random(7);
    random.fill(noise, cv::RNG::UNIFORM, 60, 200);
    cv::GaussianBlur(noise, noise, {}, 3.0);
    reference_image = noise(cv::Rect(20, 10, size.width, size.height)).clone();
    target_image = noise(cv::Rect({0, 0}, size)).clone();
    for (int y = spacing; y < size.height - 20; y += spacing) {
      for (int x = spacing; x < size.width - 30; x += spacing) {
        Correspondence c;
        c.reference_index = c.target_index = static_cast<int>(reference.size());
        c.level = c.target_index % 4 == 0 ? Level::kt : Level::ktgp;
        result.correspondences.push_back(c);
        reference.keypoints.emplace_back(cv::Point2f(x, y), 31.F);
        target.keypoints.emplace_back(cv::Point2f(x + 20, y + 10), 31.F);
      }
    }
    result.status = Status::ok;
    result.answer.homography << 1, 0, 20, 0, 1, 10, 0, 0, 1;
  }

  cv::Mat draw(OverlayStyle style) const {
    cv::Mat canvas;
    drawOverlay({reference_image, reference}, {target_image, target}, result, style, canvas);
    return canvas;
  }

  cv::Mat reference_image;
  cv::Mat target_image;
  Features reference;
  Features target;
  MatchResult result;
};

/// Over the same image twice, without keypoints.
cv::Mat drawnOver(const cv::Mat& image, const MatchResult& result, OverlayStyle style) {
  const Features none;
  cv::Mat canvas;
  drawOverlay({image, none}, {image, none}, result, style, canvas);
  return canvas;
}

TEST(Overlay, FlowDrawsEachFinalMatchAlongItsMotionAndOthersAsDots) {
  const Scene scene({640, 480});
  const cv::Mat canvas = scene.draw(OverlayStyle::flow);
  ASSERT_EQ(canvas.size(), cv::Size(640, 480));
  for (const Correspondence& c : scene.result.correspondences) {
    const cv::Point2f to = scene.target.keypoints[static_cast<std::size_t>(c.target_index)].pt;
    if (to.x < 420 && to.y < 180) continue;  // below the panel
    const cv::Point middle(cvRound(to.x) - 10, cvRound(to.y) - 5);
    const bool is_final = c.level == Level::ktgp;
    EXPECT_TRUE(isNear(canvas.at<cv::Vec3b>(to), is_final ? kFinal : kRemovedByGms)) << to;
    EXPECT_EQ(isNear(canvas.at<cv::Vec3b>(middle), kFinal), is_final) << to;
  }
}

// Its left border is now at x = 20; some of it is below lines.
TEST(Overlay, TheReferenceIsOutlinedInTheTarget) {
  for (const auto& [style, x, least] : {std::tuple(OverlayStyle::flow, 20, 270),
                                        std::tuple(OverlayStyle::side_by_side, 660, 150)}) {
    const cv::Mat canvas = Scene({640, 480}).draw(style);
    EXPECT_GT(countColour(canvas(cv::Rect(x, 200, 1, 280)), {255, 255, 255}), least);
  }
}

// F = [e]x H for an epipole e of the target, where H is the scene's translation: all lines go
// through e.
TEST(Overlay, AnEpipolarGeometryIsGreenWithLinesThroughMatches) {
  Scene scene({640, 480});
  scene.result.status = Status::model_rejected;
  scene.result.geometry = Geometry::epipolar;
  const Eigen::Vector2d epipole(-400.0, 100.0);
  Eigen::Matrix3d cross;
  cross << 0, -1, epipole.y(), 1, 0, -epipole.x(), -epipole.y(), epipole.x(), 0;
  const Eigen::Matrix3d fundamental = cross * scene.result.answer.homography;
  scene.result.two_view.view.fundamental = fundamental;
  for (const OverlayStyle style : {OverlayStyle::flow, OverlayStyle::side_by_side}) {
    const cv::Mat canvas = scene.draw(style);
    const int x0 = canvas.cols - 640;
    EXPECT_EQ(countColour(canvas, kFinal), 0);
    EXPECT_GT(countColour(canvas(cv::Rect(x0, 240, 640, 240)), kOfEpipolar), 1000);
    int white = 0;
    int ahead = 0;
    for (int y = 250; y < 430; ++y) {
      for (int x = x0 + 100; x < x0 + 500; ++x) {
        if (!isNear(canvas.at<cv::Vec3b>(y, x), {255, 255, 255})) continue;
        ++white;
        const Eigen::Vector2d from_epipole = Eigen::Vector2d(x - x0, y) - epipole;
        const cv::Point next(x + cvRound(0.04 * from_epipole.x()),
                             y + cvRound(0.04 * from_epipole.y()));
        const cv::Rect around(next - cv::Point(1, 1), cv::Size(3, 3));
        ahead += countColour(canvas(around), {255, 255, 255}) > 0 ? 1 : 0;
      }
    }
    EXPECT_GT(ahead, 0.7 * white) << "the rest is below strokes and dots";
    EXPECT_GT(white, 500);
  }
  // Lines that miss their matches are left out.
  Eigen::Matrix3d beside = scene.result.answer.homography;
  beside(1, 2) += 50.0;
  scene.result.two_view.view.fundamental = cross * beside;
  EXPECT_LT(
      countColour(scene.draw(OverlayStyle::flow)(cv::Rect(0, 240, 640, 240)), {255, 255, 255}),
      100);
}

TEST(Overlay, FlowKeepsTheImageRecognisable) {
  const Scene scene({640, 480}, 160);
  cv::Mat grey;
  cv::cvtColor(scene.draw(OverlayStyle::flow), grey, cv::COLOR_BGR2GRAY);
  const cv::Rect below(0, 240, 640, 240);  // the panel
  cv::Scalar mean;
  cv::Scalar deviation;
  cv::Scalar truth_deviation;
  cv::meanStdDev(scene.target_image(below), mean, truth_deviation);
  cv::meanStdDev(grey(below), mean, deviation);
  EXPECT_GT(mean[0], 80.0);
  EXPECT_GT(deviation[0], 0.6 * truth_deviation[0]);
}

TEST(Overlay, DifferenceOfARightHomographyIsFlatGrey) {
  Scene scene({640, 480});
  scene.target_image.convertTo(scene.target_image, -1, 0.8, 12.0);  // another exposure
  const cv::Rect below(30, 240, 600, 230);
  cv::Scalar mean;
  cv::Scalar deviation;
  cv::meanStdDev(scene.draw(OverlayStyle::difference)(below), mean, deviation);
  EXPECT_NEAR(mean[0], 128.0, 1.5);
  EXPECT_LT(deviation[0], 1.5);

  scene.result.answer.homography(0, 2) = 23.0;  // 3 px wrong
  cv::Scalar wrong;
  cv::meanStdDev(scene.draw(OverlayStyle::difference)(below), mean, wrong);
  EXPECT_GT(wrong[0], 2.0 * deviation[0]);
}

TEST(Overlay, SideBySideJoinsAtMost150) {
  const Scene scene({1920, 1080}, 12);
  ASSERT_GT(scene.result.correspondences.size(), 10000U);
  const cv::Mat canvas = scene.draw(OverlayStyle::side_by_side);
  ASSERT_EQ(canvas.size(), cv::Size(3840, 1080));
  // Along the seam each line crosses once, in strokes of 2 to 4 px.
  int runs = 0;
  bool inside = false;
  for (int y = 0; y < 1080; ++y) {
    const bool line = isNear(canvas.at<cv::Vec3b>(y, 1920), kFinal);
    runs += line && !inside ? 1 : 0;
    inside = line;
  }
  EXPECT_LE(runs, 150);
  EXPECT_GE(runs, 60);  // strokes of neighbouring matches may touch
}

TEST(Overlay, PanelStaysInsideAndIsLegible) {
  for (const cv::Size& size : {cv::Size(320, 240), cv::Size(640, 480), cv::Size(1920, 1080)}) {
    const cv::Mat canvas = Scene(size).draw(OverlayStyle::flow);
    int white = 0;
    int lowest = 0;
    for (int y = 0; y < size.height / 2; ++y) {
      for (int x = 0; x < size.width / 2; ++x) {
        if (!isNear(canvas.at<cv::Vec3b>(y, x), {255, 255, 255})) continue;
        ++white;
        lowest = y;
      }
    }
    EXPECT_GT(white, 250) << size;
    EXPECT_LT(lowest, size.height / 2) << size;
  }
}

/// The rightmost pixel beside the headline with a grey value from `low` to `high`, in the overlay
/// of a uniform image.
int rightEnd(const MatchResult& result, int grey, int low, int high) {
  const cv::Size size(640, 480);
  const cv::Mat canvas = drawnOver(test::flatImage(size, grey), result, OverlayStyle::flow);
  int right = -1;
  for (int y = 8; y < 20; ++y) {
    for (int x = 8; x < size.width - 8; ++x) {  // without the outline of the reference
      const int value = canvas.at<cv::Vec3b>(y, x)[0];
      if (value >= low && value <= high) right = std::max(right, x);
    }
  }
  return right;
}
int textEnd(const MatchResult& result) {
  return rightEnd(result, 0, 200, 255);
}

TEST(Overlay, TheHeadlineIsOnAPanelAndSaysHowFarCornersAreOffWhereThatIsKnown) {
  MatchResult result;
  result.status = Status::ok;
  result.answer.homography.setIdentity();
  result.answer.covariance = 1e-12 * Covariance8::Identity();
  const int known = textEnd(result);
  const int dark = rightEnd(result, 255, 0, 100);
  EXPECT_GT(known, 150);
  EXPECT_GT(dark, known);
  EXPECT_LT(dark, known + 40);
  result.answer.covariance.setConstant(std::numeric_limits<double>::quiet_NaN());
  const int unknown = textEnd(result);
  EXPECT_GT(unknown, 30);
  EXPECT_GT(known, unknown + 60);
}

TEST(Overlay, StagesShowEachLevelInAQuarter) {
  const Scene scene({320, 240});
  const FrameView reference{scene.reference_image, scene.reference};
  const FrameView target{scene.target_image, scene.target};
  cv::Mat canvas;
  drawStages(reference, target, scene.result, canvas);
  for (int i = 0; i < 4; ++i) {
    cv::Mat level;
    drawLevel(reference, target, scene.result, static_cast<Level>(i), level);
    const cv::Point corner(i % 2 == 0 ? 0 : canvas.cols - level.cols,
                           i / 2 == 0 ? 0 : canvas.rows - level.rows);
    const cv::Rect below(0, level.rows / 2, level.cols, level.rows / 2);  // the title
    EXPECT_EQ(cv::norm(canvas(below + corner), level(below), cv::NORM_INF), 0.0) << i;
  }
}

TEST(Overlay, ThePanelIsBelowASmallReference) {
  const cv::Mat reference(150, 200, CV_8UC1, cv::Scalar(200));
  const cv::Mat target(480, 640, CV_8UC1, cv::Scalar(100));
  const Features none;
  cv::Mat canvas;
  drawOverlay({reference, none}, {target, none}, {}, OverlayStyle::side_by_side, canvas);
  EXPECT_EQ(countColour(canvas(cv::Rect(0, 0, 200, 150)), {200, 200, 200}), 200 * 150);
  EXPECT_GT(countColour(canvas(cv::Rect(0, 150, 200, 200)), {255, 255, 255}), 50);
}

TEST(Overlay, AnyImageAndResultCanBeDrawn) {
  for (const cv::Size& size : {cv::Size(1, 1), cv::Size(3, 200), cv::Size(641, 7)}) {
    for (const auto style :
         {OverlayStyle::flow, OverlayStyle::side_by_side, OverlayStyle::difference}) {
      for (const Status status : {Status::no_model, Status::ok}) {
        MatchResult result;
        result.status = status;
        result.answer.homography << 1, 0, 1e300, 0, 1, -1e300, 1, 1, 1;
        const cv::Mat canvas = drawnOver(test::flatImage(size, 90), result, style);
        EXPECT_EQ(canvas.type(), CV_8UC3);
        EXPECT_EQ(canvas.rows, size.height);
      }
    }
  }
}

// OpenCV warps no image with a side above 32766 px. A conveyor belt or a facade may be longer.
TEST(Overlay, ALongReferenceIsComparedWithTheTarget) {
  constexpr int kLeft = 35000;
  cv::Mat reference(120, 40000, CV_8UC1);
  cv::RNG(3).fill(reference, cv::RNG::UNIFORM, 0, 255);
  cv::GaussianBlur(reference, reference, {}, 2.0);
  const cv::Mat target = reference(cv::Rect(kLeft, 0, 640, 120)).clone();
  MatchResult result;
  result.status = Status::ok;
  result.geometry = Geometry::plane;
  const Features none;
  double deviations[2];
  for (const int shift : {0, 1}) {
    result.answer.homography = test::translation(20 * shift - kLeft, 0.0);
    cv::Mat canvas;
    drawOverlay({reference, none}, {target, none}, result, OverlayStyle::difference, canvas);
    cv::Scalar mean, deviation;
    cv::meanStdDev(canvas(cv::Rect(300, 20, 200, 80)), mean, deviation);
    deviations[shift] = deviation[0];
  }
  EXPECT_LT(3.0 * deviations[0], deviations[1]);
}

TEST(Overlay, AFrameWithoutMatchShowsTheReason) {
  const cv::Mat image(480, 640, CV_8UC1, cv::Scalar(90));
  cv::Mat canvas;
  cv::Mat other;
  drawUnmatched(image, "no_reference: first frame", canvas);
  drawUnmatched(image, "no_reference: stamp went back", other);
  EXPECT_GT(countColour(canvas, {255, 255, 255}), 100);
  EXPECT_GT(cv::norm(canvas, other, cv::NORM_INF), 50.0);
}

TEST(Overlay, RefusesImagesThatAreNotEightBit) {
  const cv::Mat image(48, 64, CV_16UC1, cv::Scalar(90));
  EXPECT_THROW(drawnOver(image, {}, OverlayStyle::flow), std::invalid_argument);
}

}  // namespace
}  // namespace ktgp_orb
