// Motions below a pixel, with exact truth: drawn pictures and photographs of fine pixels, moved by
// whole fine pixels and averaged down. What is measured must be right, and its covariance, too.

#include <gtest/gtest.h>

#include <Eigen/Core>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <optional>
#include <random>
#include <string>
#include <vector>

#include "alignment_scene.h"
#include "homography/transform.h"
#include "ktgp_orb/ground_motion.h"
#include "ktgp_orb/sequence_matcher.h"
#include "ktgp_orb/stabilizer.h"
#include "motion/camera_pose.h"
#include "orb_test_images.h"
#include "test_data.h"

namespace ktgp_orb {
namespace {

/// A picture of much finer pixels than the views of it, so that the true motion between two views
/// is known to far below a pixel: a view averages kFine x kFine fine pixels, and a camera that
/// moves by a fraction of a pixel moves by whole fine ones. Nothing is interpolated.
class FinePicture {
 public:
  static constexpr int kFine = 20;    // fine pixels along a pixel
  static constexpr int kMargin = 12;  // px around a view that has not moved

  explicit FinePicture(const cv::Size& view) : view_(view) {}

  /// Shapes of many sizes, in any direction, with corners anywhere between the pixels.
  static FinePicture drawn(const cv::Size& view, unsigned seed) {
    FinePicture picture(view);
    const cv::Size size = picture.fineSize();
    picture.fine_ = cv::Mat(size, CV_8U, cv::Scalar(110));
    std::mt19937 random(seed);
    const auto number = [&](int low, int high) {
      return std::uniform_int_distribution<int>(low, high)(random);
    };
    const int shapes = view.area() / 110;
    for (int i = 0; i < shapes; ++i) {
      const cv::Point2f centre(static_cast<float>(number(0, size.width)),
                               static_cast<float>(number(0, size.height)));
      const float length = static_cast<float>(number(2 * kFine, 22 * kFine));
      const float width = static_cast<float>(number(2 * kFine, 12 * kFine));
      const float angle = static_cast<float>(number(0, 359));
      cv::Point2f corners[4];
      cv::RotatedRect(centre, {length, width}, angle).points(corners);
      std::vector<cv::Point> polygon;
      for (const cv::Point2f& corner : corners) polygon.emplace_back(corner);
      cv::fillConvexPoly(picture.fine_, polygon, cv::Scalar(number(20, 235)));
    }
    return picture;
  }

  /// The middle of a photograph, enlarged.
  static FinePicture ofPhotograph(const cv::Size& view, const cv::Mat& grey) {
    FinePicture picture(view);
    const cv::Size size = picture.fineSize();
    const double scale = std::min(grey.cols / static_cast<double>(size.width),
                                  grey.rows / static_cast<double>(size.height));
    const cv::Size part(static_cast<int>(scale * size.width),
                        static_cast<int>(scale * size.height));
    const cv::Rect middle(cv::Point((grey.cols - part.width) / 2, (grey.rows - part.height) / 2),
                          part);
    cv::resize(grey(middle), picture.fine_, size, 0.0, 0.0, cv::INTER_CUBIC);
    return picture;
  }

  /// View of a camera that has moved by whole fine pixels: the picture's content moves by
  /// (x, y) / kFine px.
  cv::Mat moved(int x, int y) const {
    const cv::Point start(kMargin * kFine - x, kMargin * kFine - y);
    cv::Mat view;
    cv::resize(fine_(cv::Rect(start, view_ * kFine)), view, view_, 0.0, 0.0, cv::INTER_AREA);
    return view;
  }

  /// View of a camera that has moved by `homography` (px, from the view that has not moved): the
  /// mean over 11x11 places in each pixel, each the nearest fine pixel.
  cv::Mat moved(const Eigen::Matrix3d& homography) const {
    constexpr int kPlaces = 11;
    constexpr double kSide = 1.0 / kPlaces;
    const Eigen::Matrix3d back = homography.inverse();
    cv::Mat view(view_, CV_8U);
    for (int y = 0; y < view_.height; ++y) {
      for (int x = 0; x < view_.width; ++x) {
        int sum = 0;
        for (int i = 0; i < kPlaces; ++i) {
          for (int j = 0; j < kPlaces; ++j) {
            const Eigen::Vector3d seen(x - 0.5 + (j + 0.5) * kSide, y - 0.5 + (i + 0.5) * kSide,
                                       1.0);
            const Eigen::Vector3d p = back * seen;
            sum += fineAt(p.x() / p.z(), p.y() / p.z());
          }
        }
        view.at<std::uint8_t>(y, x) =
            static_cast<std::uint8_t>((sum + kPlaces * kPlaces / 2) / (kPlaces * kPlaces));
      }
    }
    return view;
  }

 private:
  cv::Size fineSize() const {
    return {(view_.width + 2 * kMargin) * kFine, (view_.height + 2 * kMargin) * kFine};
  }

  std::uint8_t fineAt(double x, double y) const {
    const auto place = [](double v, int size) {
      const int fine = static_cast<int>(std::floor((v + 0.5 + kMargin) * kFine));
      return std::clamp(fine, 0, size - 1);
    };
    return fine_.at<std::uint8_t>(place(y, fine_.rows), place(x, fine_.cols));
  }

  cv::Size view_;
  cv::Mat fine_;
};

/// Photographs of Debian's opencv-doc and among the test data, where they are there. All have
/// texture in all quarters: elsewhere the error at a corner is that of an extrapolation.
std::vector<std::string> photographs() {
  std::vector<std::string> paths;
  if (const std::optional<std::string> debian = test::photoFolder()) {
    for (const char* name : {"starry_night.jpg", "aloeL.jpg", "board.jpg", "building.jpg"}) {
      paths.push_back(*debian + "/" + name);
    }
  }
  const std::optional<std::string> folder = test::dataFolder();
  if (!folder) return paths;
  for (const char* name :
       {"oxford/leuven/img1.ppm", "oxford/bikes/img1.ppm", "oxford/boat/img1.pgm",
        "hard/dogman/1.ppm", "hard/evd/1/adam.png", "hard/evd/1/cafe.png",
        "hard/homogr/BostonLibA.png", "hard/homogr/BruggeTowerA.png", "hard/homogr/EiffelA.png",
        "hard/homogr/LePoint1A.png", "hard/homogr/WhiteBoardA.jpg", "hard/notredame/img1.png",
        "targets_real/books_scene.png"}) {
    paths.push_back(*folder + "/" + name);
  }
  return paths;
}

using test::translation;
using test::withNoise;

constexpr int kFine = FinePicture::kFine;

SequenceOptions optionsOf(const std::string& name) {
  SequenceOptions options;
  if (name == "robust") options.matcher = MatcherOptions::robust();
  if (name == "teblid") options.orb.descriptor = DescriptorKind::teblid;
  if (name == "video") options.matcher.knn.search_radius = 48.0;
  return options;
}

/// Covariance of the place of `x` after the homography, px.
Eigen::Matrix2d spreadAt(const Eigen::Vector2d& x, const UncertainHomography& h) {
  const auto slope = homography::jacobianByEntries(h.homography, x);
  return slope * h.covariance * slope.transpose();
}

/// Errors of H at the corners of an image, and how large they are beside the covariance.
class Errors {
 public:
  explicit Errors(const cv::Size& size) : size_(size) {}

  void add(const UncertainHomography& found, const Eigen::Matrix3d& truth) {
    for (const Eigen::Vector2d& corner : homography::imageCorners(size_, {})) {
      const Eigen::Vector2d error =
          homography::project(found.homography, corner) - homography::project(truth, corner);
      px_.push_back(error.norm());
      squared_deviations_.push_back(error.dot(spreadAt(corner, found).inverse() * error));
    }
  }

  double median() const { return quantile(px_, 0.5); }
  double largest() const { return quantile(px_, 1.0); }
  double medianSquaredDeviation() const { return quantile(squared_deviations_, 0.5); }
  /// Share of the corners within the 99.9 % bound.
  double within() const {
    const auto inside = [](double squared) { return squared < 13.816; };
    return static_cast<double>(
               std::count_if(squared_deviations_.begin(), squared_deviations_.end(), inside)) /
           static_cast<double>(squared_deviations_.size());
  }

 private:
  static double quantile(std::vector<double> values, double share) {
    std::sort(values.begin(), values.end());
    const auto place = static_cast<std::size_t>(share * static_cast<double>(values.size()));
    return values[std::min(place, values.size() - 1)];
  }

  cv::Size size_;
  std::vector<double> px_;
  std::vector<double> squared_deviations_;
};

/// Three drawn pictures, and the photographs where there are any.
class Pictures {
 public:
  explicit Pictures(const cv::Size& view) : view_(view), photographs_(photographs()) {}
  std::size_t size() const { return 3 + photographs_.size(); }
  FinePicture operator[](std::size_t i) const {
    if (i < 3) return FinePicture::drawn(view_, static_cast<unsigned>(i));
    const std::string& path = photographs_[i - 3];
    const cv::Mat grey = cv::imread(path, cv::IMREAD_GRAYSCALE);
    EXPECT_FALSE(grey.empty()) << path;
    return FinePicture::ofPhotograph(view_, grey);
  }

 private:
  cv::Size view_;
  std::vector<std::string> photographs_;
};

const cv::Size kSize(640, 480);

/// The presets on the same images, which take longer to draw than to match.
class Presets {
 public:
  explicit Presets(bool aligned) : aligned_(aligned) {
    for (const char* name : {"ktgp", "video", "robust", "teblid"}) {
      SequenceOptions options = optionsOf(name);
      options.matcher.alignment.enabled = aligned;
      presets_.push_back({name, SequenceMatcher(options), Errors(kSize)});
    }
  }

  void add(const cv::Mat& reference, const cv::Mat& target, const Eigen::Matrix3d& truth) {
    for (Preset& preset : presets_) {
      SCOPED_TRACE(preset.name);
      preset.matcher.reset();
      preset.matcher.match(reference, 0.0);
      const auto& found = preset.matcher.match(target, 0.03).match;
      ASSERT_EQ(found.status, Status::ok);
      if (aligned_) {
        EXPECT_EQ(found.alignment.status, AlignmentStatus::ok);
      }
      preset.errors.add(found.answer, truth);
    }
  }

  /// Calls `check` with the errors of each preset.
  template <typename Check>
  void forEach(const Check& check) const {
    for (const Preset& preset : presets_) {
      SCOPED_TRACE(preset.name);
      const Errors& e = preset.errors;
      std::printf("%s: median %.4f px, largest %.4f, e'S^-1 e %.2f, within %.3f\n", preset.name,
                  e.median(), e.largest(), e.medianSquaredDeviation(), e.within());
      check(e);
    }
  }

 private:
  struct Preset {
    const char* name;
    SequenceMatcher matcher;
    Errors errors;
  };
  bool aligned_;
  std::vector<Preset> presets_;
};

// Every picture has three of the shifts 0, 0.05, ... 1.5 px, each in another direction.
TEST(SlowCamera, ShiftsAreMeasuredToAFiftiethOfAPixel) {
  const Pictures pictures(kSize);
  Presets little(true);
  Presets much(true);
  for (std::size_t i = 0; i < pictures.size(); ++i) {
    const FinePicture picture = pictures[i];
    const cv::Mat before = picture.moved(0, 0);
    for (int length = static_cast<int>(i) % 11; length <= 30; length += 11) {
      const double direction = 2.1 * static_cast<double>(i) + 0.4 * length;
      const int x = static_cast<int>(std::lround(length * std::cos(direction)));
      const int y = static_cast<int>(std::lround(length * std::sin(direction)));
      const auto truth = translation(double(x) / kFine, double(y) / kFine);
      const cv::Mat after = picture.moved(x, y);
      const auto seed = 1000 * i + 2 * x + y + 1;
      little.add(withNoise(before, 1.5, 2 * i), withNoise(after, 1.5, seed), truth);
      much.add(withNoise(before, 4.0, 2 * i), withNoise(after, 4.0, seed), truth);
    }
  }
  const auto check = [](double median, double largest) {
    return [median, largest](const Errors& errors) {
      EXPECT_LT(errors.median(), median);
      EXPECT_LT(errors.largest(), largest);
      EXPECT_GT(errors.medianSquaredDeviation(), 0.5);
      EXPECT_LT(errors.medianSquaredDeviation(), 3.0);
      EXPECT_GT(errors.within(), 0.97);
    };
  };
  little.forEach(check(0.02, 0.06));
  much.forEach(check(0.05, 0.15));
}

TEST(SlowCamera, TurnsZoomsAndTiltsAreMeasured) {
  Presets presets(true);
  const Pictures pictures(kSize);
  for (std::size_t i = 0; i < std::min<std::size_t>(pictures.size(), 8); ++i) {
    const FinePicture picture = pictures[i];
    const cv::Mat reference = withNoise(picture.moved(0, 0), 1.5, i);
    const double turn[] = {0.02, 0.1, 0.2, 0.05};
    const double zoom[] = {1.0005, 1.0, 1.002, 1.001, 1.0};
    const double tilt[] = {2e-7, 0.0, -1e-6};
    const Eigen::Matrix3d truth =
        translation(0.07, -0.03) *
        test::turn(turn[i % 4], zoom[i % 5], {tilt[i % 3], -1.3 * tilt[i % 3]});
    presets.add(reference, withNoise(picture.moved(truth), 1.5, 100 + i), truth);
  }
  presets.forEach([](const Errors& errors) {
    EXPECT_LT(errors.median(), 0.02);
    EXPECT_LT(errors.largest(), 0.1);
    EXPECT_LT(errors.medianSquaredDeviation(), 3.0);
    EXPECT_GT(errors.within(), 0.96);
  });
}

// Keypoints alone cannot measure what is less than half a pixel. They must say so.
TEST(SlowCamera, TheCovarianceOfKeypointsKnowsThatTheyLieOnWholePixels) {
  Presets presets(false);
  const Pictures pictures(kSize);
  for (std::size_t i = 0; i < std::min<std::size_t>(pictures.size(), 8); ++i) {
    const FinePicture picture = pictures[i];
    const cv::Mat reference = withNoise(picture.moved(0, 0), 1.5, i);
    for (int x = 0; x <= 30; x += 3) {
      const int y = x * 2 / 3;
      presets.add(reference, withNoise(picture.moved(-x, y), 1.5, 100 * i + x + 1),
                  translation(-double(x) / kFine, double(y) / kFine));
    }
  }
  presets.forEach([](const Errors& errors) {
    EXPECT_GT(errors.within(), 0.95);
    EXPECT_LT(errors.largest(), 3.0);
    EXPECT_GT(errors.medianSquaredDeviation(), 0.1) << "too cautious";
  });
}

/// The sum of 60 steps, or the answer in fixed mode.
UncertainHomography panned(const std::vector<cv::Mat>& frames, ReferenceMode mode) {
  SequenceOptions options = optionsOf("video");
  options.reference.mode = mode;
  SequenceMatcher matcher(options);
  matcher.fixNextFrame();
  UncertainHomography sum;
  for (std::size_t i = 0; i < frames.size(); ++i) {
    const SequenceMatch& found = matcher.match(frames[i], static_cast<double>(i) / 30.0);
    if (i == 0) continue;
    EXPECT_EQ(found.match.status, Status::ok) << i;
    sum = found.match.answer;
    if (mode == ReferenceMode::fixed) continue;
    EXPECT_TRUE(found.accumulated);
    sum.homography = found.accumulated->homography;
    sum.covariance = found.accumulated->covariance;
  }
  return sum;
}

TEST(SlowPan, StepsAddUp) {
  const cv::Size size(320, 240);
  const Eigen::Vector2d middle(160.0, 120.0);
  for (const double step : {0.2, 0.02, 0.0}) {
    const Pictures pictures(size);
    const FinePicture picture = pictures[step == 0.2 && pictures.size() > 4 ? 4 : 1];
    std::vector<cv::Mat> frames;
    for (int i = 0; i <= 60; ++i) {
      const double at = step * i - 6.0;
      const int fine = static_cast<int>(std::lround(kFine * at));
      const bool whole = std::abs(kFine * at - fine) < 1e-9;
      const cv::Mat view = whole ? picture.moved(fine, fine) : picture.moved(translation(at, at));
      frames.push_back(withNoise(view, 1.5, static_cast<std::uint64_t>(i)));
    }
    for (const ReferenceMode mode :
         {ReferenceMode::previous, ReferenceMode::keyframe, ReferenceMode::fixed}) {
      const UncertainHomography sum = panned(frames, mode);
      const Eigen::Vector2d error = homography::project(sum.homography, middle) - middle -
                                    Eigen::Vector2d::Constant(60.0 * step);
      EXPECT_LT(error.norm(), 0.15) << "step " << step << ", mode " << static_cast<int>(mode);
      EXPECT_LT(error.dot(spreadAt(middle, sum).inverse() * error), 9.0)
          << "step " << step << ", mode " << static_cast<int>(mode);
    }
  }
}

// A slow pan with a tremble of up to 0.3 px, which keypoints alone would measure as none.
TEST(SlowPan, TheStabilizerTakesOutATrembleBelowAPixel) {
  const cv::Size size(320, 240);
  const FinePicture picture = Pictures(size)[1];
  std::mt19937 random(3);
  std::uniform_int_distribution<int> tremble(-6, 6);  // fine pixels
  SequenceMatcher matcher(optionsOf("video"));
  Stabilizer stabilizer;
  std::vector<Eigen::Matrix3d> path;
  std::vector<SteadyFrame> steady;
  for (int i = 0; i <= 60; ++i) {
    const int x = 4 * i - 120 + tremble(random);
    const int y = 4 * i - 120 + tremble(random);
    const cv::Mat image = withNoise(picture.moved(x, y), 1.5, static_cast<std::uint64_t>(i));
    const SequenceMatch& found = matcher.match(image, i / 30.0);
    std::optional<Eigen::Matrix3d> step;
    if (i > 0) step = found.match.answer.homography;
    constexpr std::int64_t kPeriod = 33'000'000;  // ns
    stabilizer.add(i * kPeriod, (i - 1) * kPeriod, step, size, steady);
    path.push_back(translation(double(x) / kFine, double(y) / kFine));
  }
  ASSERT_EQ(steady.size(), path.size());
  std::vector<Eigen::Matrix3d> before;
  std::vector<Eigen::Matrix3d> after;
  for (std::size_t i = 20; i < path.size(); ++i) {
    before.emplace_back(path[i] * path[i - 1].inverse());
    after.emplace_back(steady[i].warp * before.back() * steady[i - 1].warp.inverse());
  }
  const double trembling = std::sqrt(shakeOf(before, size));
  const double left = std::sqrt(shakeOf(after, size));
  std::printf("tremble of %.3f px, %.3f px in the steady picture\n", trembling, left);
  EXPECT_LT(left, 0.25 * trembling);
}

/// A camera that drifts over flat ground, 2 m below it, and looks straight down.
class SlowFlight {
 public:
  explicit SlowFlight(double gyro_noise) : gyro_noise_(gyro_noise), ground_(options()) {}

  void start() {
    ground_.reset();
    mean_.setZero();
    squared_deviations_ = 0.0;
    frames_ = 0;
  }

  /// `image`: number `i`, which should show that velocity.
  void add(const SequenceMatch& found, int i, const Eigen::Vector3d& truth) {
    const GroundEstimate& estimate = ground_.add(frameOf(found, i));
    if (i < 2) return;
    EXPECT_EQ(estimate.status, GroundStatus::ok) << "frame " << i;
    const Eigen::Vector3d error = estimate.twist.head<3>() - truth;
    const Eigen::Matrix3d spread = estimate.twist_covariance.topLeftCorner<3, 3>();
    mean_ += error.head<2>();
    squared_deviations_ += error.dot(spread.inverse() * error);
    ++frames_;
  }

  void check(double speed) const {
    const double bias = mean_.norm() / frames_ / speed;
    const double deviation = squared_deviations_ / frames_;
    std::printf("gyro %g, %.4f m/s: bias %.2f %%, e'S^-1 e %.2f, %d frames\n", gyro_noise_, speed,
                100.0 * bias, deviation, frames_);
    EXPECT_LT(bias, 0.03) << speed << " m/s, gyro " << gyro_noise_;
    EXPECT_GT(deviation, 1.5) << speed << " m/s, gyro " << gyro_noise_;
    EXPECT_LT(deviation, 5.0) << speed << " m/s, gyro " << gyro_noise_;
  }

  /// `x`, `y`: fine pixels that the ground moves from frame to frame.
  static Eigen::Vector3d velocity(int x, int y) {
    return Eigen::Vector3d(-x, y, 0.0) / kFine * kHeight / kFocalLength * kRate;
  }

  static constexpr double kRate = 30.0;

 private:
  static constexpr double kHeight = 2.0;
  static constexpr double kFocalLength = 600.0;

  static GroundMotionOptions options() {
    GroundMotionOptions options;
    options.camera_to_base.linear() = Eigen::Vector3d(1.0, -1.0, -1.0).asDiagonal();
    options.readout_time = 0.0;
    return options;
  }

  GroundFrame frameOf(const SequenceMatch& found, int i) {
    const auto stamp = [](int number) { return std::llround(1e9 * (1 + number) / kRate); };
    GroundFrame frame;
    frame.stamp = stamp(i);
    frame.reference_stamp = stamp(i - 1);
    frame.camera << kFocalLength, 0.0, 319.5, 0.0, kFocalLength, 239.5, 0.0, 0.0, 1.0;
    frame.size = {640, 480};
    if (found.match.status == Status::ok) frame.answer = found.match.answer;
    frame.height = HeightReading{kHeight * (1.0 + 0.01 * normal_(random_)), 0.01 * kHeight};
    DownReading down;
    down.direction += 0.005 * Eigen::Vector3d(normal_(random_), normal_(random_), 0.0);
    down.direction.normalize();
    down.deviation = 0.005;
    frame.down = down;
    if (gyro_noise_ > 0.0) {
      const Eigen::Vector3d turn(normal_(random_), normal_(random_), normal_(random_));
      frame.turn = TurnReading{motion::rotationAbout(gyro_noise_ * turn), gyro_noise_};
    }
    return frame;
  }

  double gyro_noise_;  // rad from frame to frame; 0: no gyroscope
  GroundMotion ground_;
  Eigen::Vector2d mean_ = Eigen::Vector2d::Zero();  // sum of the errors, m/s
  double squared_deviations_ = 0.0;
  int frames_ = 0;
  std::mt19937 random_{5};
  std::normal_distribution<double> normal_;
};

TEST(SlowFlight, VelocitiesFromHalfACentimetrePerSecondAreMeasured) {
  const FinePicture picture = Pictures(kSize)[1];
  SlowFlight flights[] = {SlowFlight(0.0), SlowFlight(2e-5)};
  SequenceMatcher matcher(optionsOf("video"));
  for (const auto& [x, y] : {std::pair(1, 0), {2, 1}, {-3, 4}, {0, 8}, {-16, 12}}) {
    const Eigen::Vector3d truth = SlowFlight::velocity(x, y);
    matcher.reset();
    for (SlowFlight& flight : flights) flight.start();
    const int frames = std::min(60, 2 * FinePicture::kMargin * kFine / std::max(std::abs(x), y));
    for (int i = 0; i < frames; ++i) {
      const int steps = i - frames / 2;
      const auto seed = static_cast<std::uint64_t>(1000 * x + 100 * y + i);
      const cv::Mat image = withNoise(picture.moved(steps * x, steps * y), 1.5, seed);
      const SequenceMatch& found = matcher.match(image, i / SlowFlight::kRate);
      for (SlowFlight& flight : flights) flight.add(found, i, truth);
    }
    for (const SlowFlight& flight : flights) flight.check(truth.norm());
  }
}

// A frozen camera: the same picture again and again. It may have moved by as little as rounded grey
// values can hide.
TEST(FrozenCamera, StandsStillWithinWhatItsImagesCanShow) {
  const cv::Mat image = FinePicture::drawn(kSize, 5).moved(3, 7);
  for (const char* preset : {"ktgp", "video", "robust", "teblid"}) {
    SequenceMatcher matcher(optionsOf(preset));
    // An image that stays the same for as long as a camera may repeat it is one that stands still.
    for (int i = 0; i < 10; ++i) matcher.match(image, i / 30.0);
    const SequenceMatch& found = matcher.match(image, 10 / 30.0);
    ASSERT_EQ(found.match.status, Status::ok) << preset;
    EXPECT_EQ(found.match.alignment.status, AlignmentStatus::ok) << preset;
    const UncertainHomography& answer = found.match.answer;
    EXPECT_LT((answer.homography - Eigen::Matrix3d::Identity()).norm(), 1e-6) << preset;
    for (const Eigen::Vector2d& corner : homography::imageCorners(kSize, {})) {
      const double deviation = std::sqrt(spreadAt(corner, answer).trace());
      EXPECT_GT(deviation, 2e-4) << preset;
      EXPECT_LT(deviation, 0.02) << preset;
    }
  }
}

}  // namespace
}  // namespace ktgp_orb
