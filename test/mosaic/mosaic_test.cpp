// Compares the mosaic with the picture that the camera was moved over.
#include "ktgp_orb/mosaic.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <cmath>
#include <cstdio>
#include <functional>
#include <opencv2/imgproc.hpp>
#include <stdexcept>
#include <tuple>
#include <utility>
#include <vector>

#include "frame_pair.h"
#include "ktgp_orb/sequence_matcher.h"
#include "metrics/repetition.h"
#include "rolling_camera.h"

namespace ktgp_orb {
namespace {

const cv::Size kSize(320, 240);
const cv::Size kGround(1600, 1200);
constexpr std::int64_t kPeriod = 33'000'000;  // ns

/// A colour picture with corners at several scales everywhere.
cv::Mat world(int seed, const cv::Size& size = kGround) {
  cv::RNG random(static_cast<std::uint64_t>(seed));
  cv::Mat sum = cv::Mat::zeros(size, CV_32FC3);
  for (const int cell : {6, 12, 24, 48}) {
    cv::Mat blocks(size.height / cell + 1, size.width / cell + 1, CV_32FC3);
    random.fill(blocks, cv::RNG::UNIFORM, 0.0, 62.0);
    cv::Mat enlarged;
    cv::resize(blocks, enlarged, {}, cell, cell, cv::INTER_NEAREST);
    sum += enlarged(cv::Rect({0, 0}, size));
  }
  cv::GaussianBlur(sum, sum, {}, 1.0);
  cv::Mat picture;
  sum.convertTo(picture, CV_8UC3);
  return picture;
}

/// World -> frame: the upper left corner at (x, y), turned about it.
Eigen::Matrix3d viewAt(double x, double y, double angle = 0.0) {
  return Eigen::AngleAxisd(-angle, Eigen::Vector3d::UnitZ()) * test::translation(-x, -y);
}

cv::Mat see(const cv::Mat& world, const Eigen::Matrix3d& view, const cv::Size& size = kSize) {
  return test::warped(world, view, size, cv::INTER_LINEAR);
}

/// A flight over a world, the first frame of which lies at (400, 300).
class Flight {
 public:
  /// `period`: between two frames, ns.
  explicit Flight(const MosaicOptions& options, const cv::Mat& picture = world(1),
                  std::int64_t period = kPeriod, const cv::Size& size = kSize)
      : mosaic(options), world_(picture), period_(period), size_(size) {}

  /// `error`: of the given homography.
  Placement go(const Eigen::Matrix3d& view,
               const Eigen::Matrix3d& error = Eigen::Matrix3d::Identity()) {
    std::optional<Eigen::Matrix3d> h;
    if (view_) h = error * view * view_->inverse();
    return goBy(view, h);
  }
  /// From the first place, in ten steps.
  void goRight(double step) {
    for (int i = 0; i <= 10; ++i) go(viewAt(400 + step * i, 300));
  }
  Placement goLost(const Eigen::Matrix3d& view) { return goBy(view, std::nullopt); }
  /// With the homography that the matcher finds.
  Placement goMatched(const Eigen::Matrix3d& view) {
    cv::Mat image;
    cv::cvtColor(see(world_, view, size_), image, cv::COLOR_BGR2GRAY);
    const SequenceMatch& found = matcher_.match(image, 1e-9 * static_cast<double>(stamp_));
    std::optional<Eigen::Matrix3d> h;
    if (found.match.homographyStatus() == Status::ok) h = found.match.answer.homography;
    return goBy(view, h, found.reference ? found.reference->stamp : stamp_);
  }
  /// Without images, for as long as so many would take.
  void wait(int images) { stamp_ += images * period_; }
  void flyOver(const cv::Mat& picture) { world_ = picture; }
  /// A factor for the brightness of the next frames.
  void setExposure(double exposure) { exposure_ = exposure; }

  /// Mean error of the corners in the map, px.
  double error() const {
    return test::cornerError(mosaic.pose()->inverse(), first_ * view_->inverse(), size_);
  }

  Mosaic mosaic;

 private:
  Placement goBy(const Eigen::Matrix3d& view, const std::optional<Eigen::Matrix3d>& h) {
    return goBy(view, h, stamp_ - period_);
  }
  Placement goBy(const Eigen::Matrix3d& view, const std::optional<Eigen::Matrix3d>& h,
                 std::int64_t reference_stamp) {
    mosaic.follow(stamp_, reference_stamp, h);
    const Placement placement = mosaic.place(stamp_, see(world_, view, size_) * exposure_);
    if (placement == Placement::new_map) first_ = view;
    view_ = view;
    stamp_ += period_;
    return placement;
  }

  cv::Mat world_;
  std::int64_t period_;
  cv::Size size_;
  double exposure_ = 1.0;
  SequenceMatcher matcher_;
  std::int64_t stamp_ = kPeriod;
  std::optional<Eigen::Matrix3d> view_;
  Eigen::Matrix3d first_ = Eigen::Matrix3d::Identity();
};

MosaicOptions byPath() {
  MosaicOptions options;
  options.keyframes = false;
  return options;
}

/// The colours of a map and where it has any. The rim is left out, a mixture of the last pixel and
/// nothing.
struct Drawn {
  explicit Drawn(const cv::Mat& map) {
    cv::extractChannel(map, alpha, 3);
    cv::cvtColor(map, colour, cv::COLOR_BGRA2BGR);
    cv::erode(alpha, alpha, {}, {-1, -1}, 2, cv::BORDER_CONSTANT, cv::Scalar::all(0));
  }
  cv::Mat alpha, colour;
};

TEST(Mosaic, EqualsTheScene) {
  Flight flight(byPath());
  const cv::Mat picture = world(1);
  EXPECT_EQ(flight.go(viewAt(400, 300)), Placement::new_map);
  for (int i = 1; i <= 30; ++i) {
    EXPECT_EQ(flight.go(viewAt(400 + 12 * i, 300 + 7 * i, 0.01 * i)), Placement::drawn);
  }
  const cv::Mat map = flight.mosaic.image();
  const cv::Rect area = flight.mosaic.area();
  ASSERT_EQ(map.type(), CV_8UC4);
  ASSERT_EQ(map.size(), area.size());
  EXPECT_GT(area.width, 600);
  const Drawn drawn(map);
  EXPECT_GT(cv::countNonZero(drawn.alpha), 3 * kSize.area() / 2);
  cv::Mat difference;
  cv::absdiff(drawn.colour, picture(area + cv::Point(400, 300)), difference);
  EXPECT_LT(cv::mean(difference, drawn.alpha)[1], 4.0);
  EXPECT_EQ(flight.mosaic.image().size(), area.size());
}

TEST(Mosaic, BlendsSoThatNoSeamShows) {
  const cv::Mat dark(1200, 1600, CV_8UC3, cv::Scalar::all(80));
  const cv::Mat light(1200, 1600, CV_8UC3, cv::Scalar::all(160));
  MosaicOptions options = byPath();
  options.gain = false;
  Flight flight(options, dark);
  flight.go(viewAt(400, 300));
  flight.flyOver(light);
  EXPECT_EQ(flight.go(viewAt(520, 300)), Placement::drawn);
  const cv::Mat map = flight.mosaic.image();
  int steepest = 0;
  const int row = 120;
  for (int x = 1; x < map.cols; ++x) {
    steepest = std::max(steepest,
                        std::abs(map.at<cv::Vec4b>(row, x)[1] - map.at<cv::Vec4b>(row, x - 1)[1]));
  }
  EXPECT_EQ(map.at<cv::Vec4b>(row, 60)[1], 80);
  EXPECT_EQ(map.at<cv::Vec4b>(row, 420)[1], 160);
  EXPECT_LE(steepest, 10) << "of a step of 80";
}

/// Mean difference from the world, grey values, after a flight in which frames become darker, and
/// bright again on the way back.
double errorOfARamp(const MosaicOptions& options) {
  const cv::Mat picture = world(1);
  Flight flight(options, picture);
  for (int i = 0; i <= 60; ++i) {
    const int step = i <= 40 ? i : 80 - i;
    flight.setExposure(1.0 - 0.012 * step);
    flight.go(viewAt(400 + 15 * step, 300 + 5 * i));
  }
  const Drawn map(flight.mosaic.image());
  const cv::Mat truth = picture(flight.mosaic.area() + cv::Point(400, 300));
  const cv::Scalar difference = cv::mean(map.colour, map.alpha) - cv::mean(truth, map.alpha);
  return difference[1];
}

TEST(Mosaic, KeepsItsBrightnessWhenTheExposureChanges) {
  MosaicOptions options = byPath();
  EXPECT_NEAR(errorOfARamp(options), 0.0, 2.0) << "of about 120";
  options.gain = false;
  EXPECT_LT(errorOfARamp(options), -20.0) << "else the test shows nothing";
}

TEST(Mosaic, KeyframesReduceDrift) {
  // Each homography is off by a fifth of a pixel, as if the camera rotated: the errors add up.
  const auto fly = [](const MosaicOptions& options) {
    Flight flight(options);
    flight.go(viewAt(400, 300));
    for (int i = 1; i <= 60; ++i) {
      const double a = 2.0 * 3.14159265 * i / 60.0;
      flight.go(viewAt(400 + 200 * (1 - std::cos(a)), 300 + 150 * std::sin(a)),
                test::translation(0.2, 0.0));
    }
    EXPECT_EQ(flight.mosaic.maps(), 1U);
    return flight.error();
  };
  EXPECT_GT(fly(byPath()), 8.0);
  EXPECT_LT(fly({}), 0.3);
}

/// The view of a camera that has moved by `x` px over hills of `relief` of its height.
cv::Mat seeHills(const cv::Mat& world, double x, double relief) {
  cv::Mat map(kSize, CV_32FC2);
  for (int row = 0; row < kSize.height; ++row) {
    for (int column = 0; column < kSize.width; ++column) {
      double across = 400.0 + x + column;
      for (int i = 0; i < 10; ++i) {
        const double hill = std::sin(across / 50.0) * std::cos((300.0 + row) / 50.0);
        across = 400.0 + column + x * (1.0 + relief * hill);
      }
      map.at<cv::Vec2f>(row, column) = {static_cast<float>(across),
                                        300.F + static_cast<float>(row)};
    }
  }
  cv::Mat frame;
  cv::remap(world, frame, map, cv::noArray(), cv::INTER_LINEAR);
  return frame;
}

TEST(Mosaic, KnowsAWorldThatIsNoPlane) {
  for (const double relief : {0.0, 0.03}) {
    Mosaic mosaic;
    for (int i = 0; i <= 40; ++i) {
      std::optional<Eigen::Matrix3d> h;
      if (i > 0) h = test::translation(-4.0, 0.0);
      mosaic.follow((i + 1) * kPeriod, i * kPeriod, h);
      mosaic.place((i + 1) * kPeriod, seeHills(world(1), 4.0 * i, relief));
    }
    EXPECT_EQ(mosaic.maps(), 1U);
    EXPECT_EQ(mosaic.hasParallax(), relief > 0.0) << mosaic.planeDeviation() << " px";
    EXPECT_NEAR(mosaic.planeDeviation(), relief > 0.0 ? 1.2 : 0.0, relief > 0.0 ? 0.7 : 0.1);
    mosaic.reset();
    EXPECT_FALSE(mosaic.hasParallax());
  }
}

TEST(Mosaic, StopsGrowingAtItsBound) {
  MosaicOptions options = byPath();
  options.max_megapixels = 1.0;
  Flight flight(options, world(1, {6000, 800}));
  flight.go(viewAt(100, 200));
  EXPECT_FALSE(flight.mosaic.full());
  for (int i = 1; i <= 180; ++i) flight.go(viewAt(100 + 30 * i, 200));
  EXPECT_TRUE(flight.mosaic.full());
  EXPECT_LE(flight.mosaic.megapixels(), 1.0);
  EXPECT_GT(flight.mosaic.megapixels(), 0.8);
  EXPECT_LT(flight.error(), 1e-3) << "it still knows where it is";
}

TEST(Mosaic, ADiagonalFlightEndsWhereItsPictureWouldBeTooLarge) {
  MosaicOptions options = byPath();
  options.max_megapixels = 8.0;
  Flight flight(options, world(1), kPeriod, {160, 120});
  for (int i = 0; i <= 400; ++i) flight.go(viewAt(100 + 30 * i, 100 + 22 * i));
  EXPECT_TRUE(flight.mosaic.full());
  EXPECT_LT(flight.mosaic.megapixels(), 7.0) << "the tiles are not the reason";
  const cv::Mat picture = flight.mosaic.image();
  EXPECT_LE(picture.total(), 64'000'000U);
  EXPECT_GT(picture.total(), 60'000'000U);
  EXPECT_LT(flight.error(), 1e-3) << "it still knows where it is";
}

TEST(Mosaic, KeepsItsMapWithOtherDescriptors) {
  Flight flight({});
  flight.goRight(20);
  MosaicOptions options = flight.mosaic.options();
  options.orb.descriptor = DescriptorKind::teblid;
  flight.mosaic.setOptions(options);
  for (int i = 0; i <= 10; ++i) flight.go(viewAt(600 + 20 * i, 300));
  EXPECT_EQ(flight.goLost(viewAt(700, 330, 0.2)), Placement::drawn);
  EXPECT_LT(flight.error(), 0.5);
  EXPECT_EQ(flight.mosaic.maps(), 1U);
}

TEST(Mosaic, FindsItsPlaceAgainAfterAGap) {
  Flight flight({});
  flight.goRight(20);
  EXPECT_EQ(flight.goLost(viewAt(500, 330, 0.2)), Placement::drawn);
  EXPECT_LT(flight.error(), 0.3);
  EXPECT_EQ(flight.mosaic.maps(), 1U);
}

// Photographs of a survey, of which each shows four fifths of the one before. Two that show
// nothing, one after the other, are no end of the map, however long that takes.
TEST(Mosaic, ContinuesAfterBlankPhotographs) {
  for (const std::int64_t seconds : {1, 5}) {
    Flight flight({}, world(1), seconds * 1'000'000'000);
    flight.go(viewAt(400, 300));
    const auto place = [](int i) { return viewAt(400 + 64.0 * i, 300 + 3.0 * i, 0.01 * i); };
    for (int i = 1; i <= 10; ++i) {
      const bool shows_nothing = i == 4 || i == 5;
      if (shows_nothing) flight.flyOver(cv::Mat(1200, 1600, CV_8UC3, cv::Scalar::all(120)));
      if (i == 6) flight.flyOver(world(1));
      const Placement placement = i >= 4 && i <= 6 ? flight.goLost(place(i)) : flight.go(place(i));
      EXPECT_EQ(placement, shows_nothing ? Placement::lost : Placement::drawn)
          << seconds << " " << i;
      if (placement == Placement::drawn) {
        // The first frame after the gap is placed by two fifths of a frame.
        EXPECT_LT(flight.error(), i < 6 ? 1.0 : 4.0) << seconds << " " << i;
      }
    }
    EXPECT_EQ(flight.mosaic.maps(), 1U) << seconds;
    EXPECT_GT(flight.mosaic.area().width, 940) << seconds;
    // Elsewhere it does not go on searching for ever.
    flight.flyOver(world(2));
    int lost = 0;
    while (lost < 10 && flight.goLost(viewAt(400, 300)) == Placement::lost) ++lost;
    EXPECT_EQ(lost, 3) << seconds;
    EXPECT_EQ(flight.mosaic.maps(), 2U) << seconds;
  }
}

/// World -> frame: the camera looks at (x, y), zoomed, turned and tilted.
Eigen::Matrix3d tiltedAt(double x, double y, double zoom, double turn, double tilt) {
  constexpr double kFocalLength = 320.0;  // px
  const Eigen::Matrix3d turned = (Eigen::AngleAxisd(tilt, Eigen::Vector3d::UnitX()) *
                                  Eigen::AngleAxisd(turn, Eigen::Vector3d::UnitZ()))
                                     .toRotationMatrix();
  Eigen::Matrix3d plane;
  plane << turned.col(0), turned.col(1), Eigen::Vector3d(0.0, 0.0, kFocalLength);
  const double focal = kFocalLength * zoom;
  const Eigen::Matrix3d h = test::cameraMatrix(focal, focal, 159.5, 119.5) * plane * viewAt(x, y);
  return h / h(2, 2);
}

/// A printed checkerboard, `square` px a square, with a little dirt: it looks about the same moved
/// by two squares.
cv::Mat checkerboard(int square, double dirt) {
  cv::Mat picture = world(3);
  for (int y = 0; y < picture.rows; ++y) {
    for (int x = 0; x < picture.cols; ++x) {
      auto& pixel = picture.at<cv::Vec3b>(y, x);
      const double paper = (x / square + y / square) % 2 == 0 ? 190.0 : 30.0;
      for (int c = 0; c < 3; ++c) {
        pixel[c] = cv::saturate_cast<std::uint8_t>(paper + dirt * (pixel[c] - 124.0));
      }
    }
  }
  cv::GaussianBlur(picture, picture, {}, 1.0);
  return picture;
}

/// The square picture `one` again and again, with a little dirt.
cv::Mat repeated(const cv::Mat& one, double dirt, const cv::Size& size) {
  cv::Mat picture;
  cv::repeat(one, size.height / one.rows + 1, size.width / one.cols + 1, picture);
  picture = picture(cv::Rect({0, 0}, size)).clone();
  cv::addWeighted(picture, 1.0, world(6, size), dirt, -124.0 * dirt, picture);
  cv::GaussianBlur(picture, picture, {}, 0.8);
  return picture;
}

/// Slabs of `period` px that all look the same, with a little dirt.
cv::Mat tiles(int period, double dirt, const cv::Size& size = kGround) {
  const cv::Mat slab = world(5)(cv::Rect(0, 0, period, period)).clone();
  cv::rectangle(slab, cv::Rect(0, 0, period, period), cv::Scalar::all(20),
                std::max(1, period / 20));
  return repeated(slab, dirt, size);
}

/// A facade: bright windows with a cross.
cv::Mat windows(int period, const cv::Size& size = kGround, double dirt = 0.15) {
  cv::Mat one(period, period, CV_8UC3, cv::Scalar(90, 110, 140));
  const cv::Rect pane(period / 5, period / 5, 3 * period / 5, 3 * period / 5);
  cv::rectangle(one, pane, cv::Scalar(220, 210, 190), cv::FILLED);
  const int bar = std::max(1, period / 16);
  cv::rectangle(one, {period / 2, pane.y, bar, pane.height}, cv::Scalar::all(50), cv::FILLED);
  cv::rectangle(one, {pane.x, 2 * period / 5, pane.width, bar}, cv::Scalar::all(50), cv::FILLED);
  return repeated(one, dirt, size);
}

/// Pallets side by side: boards with gaps over a dark floor.
cv::Mat pallets(int period, const cv::Size& size = kGround, double dirt = 0.15) {
  cv::Mat one(period, period, CV_8UC3, cv::Scalar(40, 45, 50));
  for (int board = 0; board < 5; ++board) {
    const int shade = 150 + 15 * (board * 2 % 5);
    cv::rectangle(one, {period / 20, board * period / 5 + period / 40, 9 * period / 10, period / 7},
                  cv::Scalar(shade - 60, shade - 20, shade), cv::FILLED);
  }
  for (const int x : {1, 5, 9}) {  // nails
    cv::circle(one, {x * period / 10, period / 2}, std::max(1, period / 50), cv::Scalar::all(30),
               cv::FILLED);
  }
  return repeated(one, dirt, size);
}

/// Dark spots of several sizes hide the period.
cv::Mat spotted(cv::Mat picture) {
  cv::RNG random(11);
  for (int i = 0; i < picture.cols * 25 / 16; ++i) {
    const cv::Point at(random.uniform(0, picture.cols), random.uniform(0, picture.rows));
    cv::circle(picture, at, random.uniform(2, 9), cv::Scalar::all(random.uniform(10, 70)),
               cv::FILLED, cv::LINE_AA);
  }
  return picture;
}

/// A drawn picture in grey levels, 320 px wide.
cv::Mat grey(const cv::Mat& picture) {
  cv::Mat image;
  cv::cvtColor(picture(cv::Rect({400, 300}, kSize)), image, cv::COLOR_BGR2GRAY);
  return image;
}

// Otherwise each gap would leave one more keyframe of the same place. Only the nearest few are
// tried, so those of other places would not be.
TEST(Mosaic, GapsAtOnePlaceAddNoKeyframes) {
  Flight flight(MosaicOptions{});
  flight.go(viewAt(400, 300));
  for (int i = 1; i < 30; ++i) {
    EXPECT_NE(flight.goLost(viewAt(400.0 + i % 3, 300)), Placement::lost) << i;
  }
  EXPECT_EQ(flight.mosaic.keyframes(), 1U);
}

TEST(Repetition, ShortestPeriodIsFound) {
  // The period of a checkerboard: one square to the side and one down.
  for (const int square : {16, 24, 40}) {
    EXPECT_NEAR(metrics::shortestPeriod(grey(checkerboard(square, 0.3))), square * std::sqrt(2.0),
                0.1 * square);
  }
  EXPECT_EQ(metrics::shortestPeriod(grey(world(1))), 0.0);
  cv::Mat smooth;
  cv::GaussianBlur(grey(world(1)), smooth, {}, 40.0);
  EXPECT_EQ(metrics::shortestPeriod(smooth), 0.0) << "like its neighbourhood, and not moved";
  cv::Mat fine(72, 96, CV_8UC1);
  for (int x = 0; x < fine.cols; ++x) fine.col(x).setTo(x % 3 == 0 ? 200 : 50);
  EXPECT_GE(metrics::shortestPeriod(fine), 0.02 * fine.cols);
  for (const int period : {60, 100, 150, 190}) {  // up to three fifths
    EXPECT_NEAR(metrics::shortestPeriod(grey(tiles(period, 0.1))), period, 6.0);
  }
  EXPECT_EQ(metrics::shortestPeriod(cv::Mat(10, 2000, CV_8UC1, cv::Scalar(90))), 0.0) << "a strip";
}

TEST(Mosaic, RepetitiveGroundIsNotOffByAPeriod) {
  constexpr int kSquare = 24;
  const Eigen::Matrix3d period = test::translation(2.0 * kSquare, 0.0);
  for (const bool keyframes : {false, true}) {
    MosaicOptions options;
    options.keyframes = keyframes;
    Flight flight(options, checkerboard(kSquare, 0.4));
    flight.goRight(4);
    ASSERT_LT(flight.error(), 1.0);
    const Placement placement = flight.go(viewAt(444, 300), period);
    if (keyframes) {  // they know better than the homography
      EXPECT_NE(placement, Placement::lost);
      EXPECT_LT(flight.error(), 1.0);
    } else {
      EXPECT_EQ(placement, Placement::lost);
    }
  }
}

/// Placed frames of a flight, how many of them lie more than half a period off, and lost frames.
struct PlacedAndOff {
  int placed = 0, off = 0, lost = 0;
};

void count(Placement placement, const Flight& flight, double period, PlacedAndOff& counts) {
  counts.lost += placement == Placement::lost ? 1 : 0;
  if (placement != Placement::drawn && placement != Placement::seen) return;
  ++counts.placed;
  counts.off += flight.error() > 0.5 * period ? 1 : 0;
}

// Every homography is right; a keyframe alone would fit as well one period farther.
TEST(Mosaic, FollowsTheHomographiesOverTilesOfAnyPeriod) {
  constexpr std::int64_t kTwentyASecond = 50'000'000;  // ns
  for (const int period : {7, 13, 20, 32, 50, 75, 100, 130, 160, 190}) {
    Flight flight({}, tiles(period, 0.1), kTwentyASecond);
    PlacedAndOff steady, after;
    const double step = std::min(0.2 * period, 15.0);
    double x = 100.0;
    for (int i = 0; i < 20; ++i) count(flight.go(viewAt(x += step, 300)), flight, period, steady);
    EXPECT_EQ(steady.off, 0) << period;
    EXPECT_GE(steady.placed, 15) << period;
    const auto goOn = [&] {
      for (int i = 0; i < 5; ++i) count(flight.go(viewAt(x += step, 300)), flight, period, after);
    };
    flight.wait(4);  // a gap, after which the homography is a period off
    x += 1.4 * period;
    count(flight.go(viewAt(x, 300), test::translation(period, 0.0)), flight, period, after);
    goOn();
    flight.wait(10);  // a gap without a homography
    x += 2.3 * period;
    count(flight.goLost(viewAt(x, 300)), flight, period, after);
    goOn();
    EXPECT_EQ(after.off, 0) << period;
  }
}

/// Repeating ground that a camera flies over, `jump` periods within one step at half of the way.
struct RepeatingGround {
  cv::Mat picture;
  int period;
  double jump;
};

/// The frames of a flight by the matcher's homographies, with the jump and a gap of nine images.
PlacedAndOff flyOver(const RepeatingGround& ground, int& lost_as_repetitive,
                     const cv::Size& size = kSize) {
  PlacedAndOff counts;
  Flight flight({}, ground.picture, 50'000'000, size);
  const double step = std::min(0.2 * ground.period, 15.0);
  double x = 100.0;
  const auto go = [&](double way) {
    count(flight.goMatched(viewAt(x += way, 300)), flight, ground.period, counts);
    const bool is_repetitive = flight.mosaic.lostBecause() == LostBecause::repeats;
    lost_as_repetitive += is_repetitive ? 1 : 0;
  };
  for (int i = 0; i < 8; ++i) go(step);
  go(ground.jump * ground.period);
  for (int i = 0; i < 4; ++i) go(step);
  flight.wait(9);
  go(1.6 * ground.period);
  for (int i = 0; i < 3; ++i) go(step);
  return counts;
}

constexpr double kLittleDirt = 0.1;
constexpr double kMuchDirt = 0.5;

// After a jump, the homography may be a period off, and so may the place by a keyframe.
TEST(Mosaic, MatchedFramesOverRepeatingGroundAreRightOrLost) {
  for (const double dirt : {kLittleDirt, kMuchDirt}) {
    PlacedAndOff all;
    int lost_as_repetitive = 0;
    for (const RepeatingGround& each :
         {RepeatingGround{tiles(26, dirt), 26, 1.4}, RepeatingGround{tiles(130, dirt), 130, 0.8},
          RepeatingGround{tiles(160, dirt), 160, 1.4},
          RepeatingGround{spotted(tiles(160, dirt)), 160, 0.8},
          RepeatingGround{windows(100, kGround, dirt), 100, 1.4},
          RepeatingGround{pallets(120, kGround, dirt), 120, 0.8}}) {
      const PlacedAndOff counts = flyOver(each, lost_as_repetitive);
      EXPECT_EQ(counts.off, 0) << each.period << " " << each.jump << " " << dirt;
      all.placed += counts.placed;
      all.lost += counts.lost;
    }
    std::printf("%g of dirt: %d placed, %d lost\n", dirt, all.placed, all.lost);
    // With little dirt, only the spots tell where the camera is after the jump.
    EXPECT_GE(all.placed, dirt == kLittleDirt ? 30 : all.lost + 1);
    // Between spots or behind dirt that hides the period, a frame may match nothing.
    EXPECT_GE(lost_as_repetitive, all.lost - (dirt == kLittleDirt ? 2 : 4));
  }
}

// Minutes; run by `ctest -L long`: periods of 2 to 60 % of the image's width, in two sizes of
// images.
TEST(Mosaic, DISABLED_MatchedFramesOverRepeatingGroundsOfAllPeriodsAreRightOrLost) {
  using Draw = std::function<cv::Mat(int)>;
  const cv::Size long_ground(2560, 1200);  // for the longest way
  const std::pair<const char*, Draw> grounds[] = {
      {"slabs", [=](int period) { return tiles(period, 0.1, long_ground); }},
      {"spotted slabs", [=](int period) { return spotted(tiles(period, 0.1, long_ground)); }},
      {"windows", [=](int period) { return windows(period, long_ground); }},
      {"pallets", [=](int period) { return pallets(period, long_ground); }},
  };
  for (const cv::Size& size : {kSize, cv::Size(640, 480)}) {
    for (const auto& [name, draw] : grounds) {
      PlacedAndOff all;
      int flights = 0, wrong = 0, lost_as_repetitive = 0;
      for (const double share : {0.02, 0.05, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6}) {
        const int period = static_cast<int>(std::lround(share * size.width));
        const cv::Mat picture = draw(period);
        for (const double jump : {0.8, 1.4, 2.3}) {
          const PlacedAndOff counts = flyOver({picture, period, jump}, lost_as_repetitive, size);
          EXPECT_EQ(counts.off, 0) << size << " " << name << " " << period << " px, jump " << jump;
          ++flights;
          wrong += counts.off > 0 ? 1 : 0;
          all.placed += counts.placed;
          all.off += counts.off;
          all.lost += counts.lost;
        }
      }
      std::printf(
          "%d px, %s: %d flights, %d with a frame off; frames: %d placed, %d off, %d lost\n",
          size.width, name, flights, wrong, all.placed, all.off, all.lost);
    }
  }
}

TEST(Mosaic, SaysThatTheCameraHasTurnedTooFarForOnePlane) {
  const std::function<Eigen::Matrix3d(int)> motions[] = {
      [](int i) { return tiltedAt(760, 570, 1.0, 0.0, 0.035 * i); },           // looks up
      [](int i) { return tiltedAt(760, 570, 1.0, 0.5 * M_PI, 0.035 * i); },    // aside
      [](int i) { return tiltedAt(760, 570, std::pow(1.05, i), 0.0, 0.0); }};  // comes near
  for (const auto& view : motions) {
    Flight flight({});
    Placement placement = flight.go(view(0));
    for (int i = 1; i <= 40 && placement != Placement::lost; ++i) {
      placement = flight.go(view(i));
      if (placement != Placement::lost) {
        EXPECT_EQ(flight.mosaic.lostBecause(), LostBecause::nothing) << i;
      }
    }
    ASSERT_EQ(placement, Placement::lost);
    EXPECT_EQ(flight.mosaic.lostBecause(), LostBecause::zoomed);
  }
}

TEST(Mosaic, DoesNotGuessWhichPeriodItSeesAfterALongGap) {
  for (const bool repeats : {false, true}) {
    for (const int missing : {1, 30}) {
      Flight flight({}, repeats ? checkerboard(24, 0.4) : world(1));
      flight.goRight(4);
      flight.wait(missing);
      const Placement placement = flight.goLost(viewAt(440 + 4 * missing, 300));
      if (placement == Placement::lost) {
        EXPECT_TRUE(repeats && missing > 3) << repeats << " " << missing;
        EXPECT_EQ(flight.mosaic.lostBecause(), LostBecause::repeats) << missing;
      } else {  // the dirt tells the period
        EXPECT_LT(flight.error(), 1.0) << repeats << " " << missing;
      }
    }
  }
}

/// After a long gap, only the look of a frame tells which of the slabs it shows. It counts if the
/// frame differs from its copy, a slab farther, by more than 3 %.
TEST(Mosaic, TrustsTheLookOfAFrameThatDiffersFromItsOwnCopy) {
  for (const auto& [dirt, difference] : {std::pair(0.33, 0.024), std::pair(0.45, 0.044)}) {
    const cv::Mat slabs = tiles(50, dirt);
    ASSERT_NEAR(1.0 - metrics::alikenessToItself(metrics::shrunk(grey(slabs))), difference, 0.003);
    Flight flight({}, slabs);
    flight.goRight(4);
    flight.wait(30);
    const Placement placement = flight.goLost(viewAt(400, 300));
    if (difference < 0.03) {
      EXPECT_EQ(placement, Placement::lost);
      EXPECT_EQ(flight.mosaic.lostBecause(), LostBecause::repeats);
    } else {
      EXPECT_EQ(placement, Placement::drawn);
      EXPECT_LT(flight.error(), 1.0);
    }
  }
}

TEST(Mosaic, FindsItsPlaceAgainFromAZoomedAndTiltedViewByGrowth) {
  for (const bool growth : {false, true}) {
    MosaicOptions options;
    options.matcher.growth.enabled = growth;
    Flight flight(options);
    flight.go(viewAt(400, 300));
    const Placement placement = flight.goLost(tiltedAt(640, 468, 1.5, 0.5, 0.7));
    EXPECT_EQ(placement, growth ? Placement::drawn : Placement::lost);
    if (growth) {
      EXPECT_LT(flight.error(), 1.0);
    }
    EXPECT_EQ(flight.mosaic.maps(), 1U);
  }
}

TEST(Mosaic, BeginsANewMapWhereNothingLeadsOn) {
  Flight flight(MosaicOptions{});
  flight.goRight(20);
  flight.flyOver(world(2));
  int lost = 0;
  Placement placement = flight.goLost(viewAt(400, 300));
  while (placement == Placement::lost && lost < 100) {
    EXPECT_FALSE(flight.mosaic.pose());
    ++lost;
    placement = flight.goLost(viewAt(400, 300));
  }
  EXPECT_EQ(placement, Placement::new_map);
  EXPECT_NEAR(lost, 1.0 / 0.033, 2);
  EXPECT_EQ(flight.mosaic.maps(), 2U);
  EXPECT_EQ(flight.mosaic.area().size(), kSize) << "nothing of the old map is left";
}

/// Homography of a camera that flies to and fro in rows, by up to 160 px/s: plane -> image at a
/// time, s.
Eigen::Matrix3d toAndFro(double seconds) {
  const double phase = 0.8 * seconds;
  return viewAt(600.0 - 200.0 * std::cos(phase), 300.0 + 20.0 * seconds,
                0.03 * std::sin(3.0 * seconds));
}

/// Root mean squares over points of the ground, px in the map.
struct MapErrors {
  double spread = 0.0;  // deviation of a point's places from its mean place
  double bent = 0.0;    // deviation of its mean place from the true one
};

MapErrors errorsInMap(const test::RollingCamera& camera) {
  constexpr int kFrames = 240;
  constexpr double kSeconds = 1e-9 * kPeriod;
  const cv::Mat ground = world(1);
  Mosaic mosaic;
  std::vector<std::pair<double, Eigen::Matrix3d>> placed;
  for (int i = 0; i < kFrames; ++i) {
    const double now = i * kSeconds;
    std::optional<Eigen::Matrix3d> step;
    if (i > 0) step = camera.view(now) * camera.view(now - kSeconds).inverse();
    const std::int64_t stamp = i * kPeriod;
    mosaic.follow(stamp, stamp - kPeriod, step);
    EXPECT_NE(mosaic.place(stamp, camera.picture(ground, now)), Placement::lost);
    placed.emplace_back(now, mosaic.pose().value_or(Eigen::Matrix3d::Identity()));
  }
  EXPECT_EQ(mosaic.maps(), 1U);
  double spread = 0.0, bent = 0.0;
  int count = 0;
  for (int i = 0; i < kFrames; i += 10) {
    for (const Eigen::Vector2d& point : camera.points(i * kSeconds)) {
      std::vector<Eigen::Vector2d> places;
      Eigen::Vector2d mean = Eigen::Vector2d::Zero();
      for (const auto& [seconds, from_map] : placed) {
        const Eigen::Vector2d seen = camera.seen(point, seconds);
        if (seen.x() < 0.0 || seen.y() < 0.0 || seen.x() > 319.0 || seen.y() > 239.0) continue;
        places.emplace_back((from_map.inverse() * seen.homogeneous()).hnormalized());
        mean += places.back();
      }
      mean /= static_cast<double>(places.size());
      const Eigen::Vector2d truth = (camera.view(0.0) * point.homogeneous()).hnormalized();
      for (const Eigen::Vector2d& place : places) {
        spread += (place - mean).squaredNorm();
        bent += (mean - truth).squaredNorm();
        ++count;
      }
    }
  }
  return {std::sqrt(spread / count), std::sqrt(bent / count)};
}

// A frame's homography has most of what a rolling shutter bends, 2.6 and 4.8 px from its first row
// to the last one; what it has not is all that taking the shutter out could gain.
TEST(Mosaic, FramesOfARollingShutterFitEachOther) {
  for (const auto& [readout, spread, bent] :
       {std::tuple(0.0, 0.03, 0.1), std::tuple(0.016, 0.08, 0.6), std::tuple(0.03, 0.14, 1.1)}) {
    const MapErrors errors = errorsInMap({toAndFro, readout, kSize});
    std::printf("readout %.0f ms: apart by %.3f px, bent by %.3f px\n", 1e3 * readout,
                errors.spread, errors.bent);
    EXPECT_LT(errors.spread, spread) << readout;
    EXPECT_LT(errors.bent, bent) << readout;
  }
}

TEST(Mosaic, PictureIsBoundedAndShowsWhereTheCameraIs) {
  const cv::Mat grey(1200, 1600, CV_8UC3, cv::Scalar::all(120));
  Flight flight(byPath(), grey);
  EXPECT_TRUE(flight.mosaic.picture(400).empty());
  flight.go(viewAt(400, 300));
  for (int i = 1; i <= 20; ++i) flight.go(viewAt(400 + 30 * i, 300));
  const cv::Mat picture = flight.mosaic.picture(400);
  EXPECT_EQ(picture.cols, 400);
  cv::Mat white;
  cv::inRange(picture, cv::Scalar::all(180), cv::Scalar::all(255), white);
  const cv::Rect outline = cv::boundingRect(white);
  const double scale = 400.0 / flight.mosaic.area().width;
  EXPECT_NEAR(outline.x, 600 * scale, 3);
  EXPECT_NEAR(outline.br().x, 400, 3);
  EXPECT_NEAR(outline.height, 240 * scale, 3);
}

TEST(Mosaic, DrawsOnlyWhatMoved) {
  Flight flight(byPath());
  flight.go(viewAt(400, 300));
  EXPECT_EQ(flight.go(viewAt(403, 300)), Placement::seen);
  EXPECT_EQ(flight.go(viewAt(406, 300)), Placement::seen);
  EXPECT_EQ(flight.go(viewAt(412, 300)), Placement::drawn);
}

TEST(Mosaic, TheMapEndsWhereASlowCameraStopped) {
  for (const bool is_cut : {false, true}) {
    MosaicOptions options = byPath();
    options.gain = false;
    Flight flight(options);
    int width = 0;
    flight.mosaic.onFinishedMap([&](const cv::Mat& map) { width = map.cols; });
    for (int i = 0; i <= 39; ++i) flight.go(viewAt(400 + i, 300));
    EXPECT_NEAR(flight.mosaic.area().width, 320 + 30, 1) << "drawn every 10 px";
    if (!is_cut) width = flight.mosaic.image().cols;
    for (int i = 0; is_cut && i < 40; ++i) flight.goLost(viewAt(900, 300));
    EXPECT_NEAR(width, 320 + 39, 1) << is_cut;
  }
}

TEST(Mosaic, RefusesImagesOfNoUse) {
  Mosaic mosaic;
  EXPECT_THROW(mosaic.place(1, cv::Mat::zeros(kSize, CV_16UC1)), std::invalid_argument);
}

}  // namespace
}  // namespace ktgp_orb
