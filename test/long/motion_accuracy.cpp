// Metric motion on exact flights: drift, velocity error and its covariance, with the matcher's
// homographies and with those of optical flow and MAGSAC++. Run by `ctest -L long`.
//   motion_accuracy FOLDER FLIGHTS SECONDS
// FOLDER keeps the homographies, so that a second run takes seconds. Prints the table of
// doc/measurements/motion.md, and fails where one of its bounds does not hold.

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <Eigen/LU>
#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <functional>
#include <opencv2/calib3d.hpp>
#include <opencv2/core.hpp>
#include <opencv2/core/eigen.hpp>
#include <opencv2/imgproc.hpp>
#include <opencv2/video/tracking.hpp>
#include <random>
#include <string>
#include <vector>

#include "demo/effects.h"
#include "demo/flight.h"
#include "demo/map.h"
#include "ground_flight.h"
#include "homography/transform.h"
#include "ktgp_orb/ground_motion.h"
#include "ktgp_orb/sequence_matcher.h"
#include "motion/camera_pose.h"
#include "synthetic_pairs.h"

namespace ktgp_orb {
namespace {

/// A flight over the drawn map with random height, speed, yaw and tilt: exact at every time. The
/// height is 600 px of the map in the middle, so pictures have details at every height.
class ExactFlight {
 public:
  explicit ExactFlight(std::uint64_t seed) {
    std::mt19937_64 random(seed);
    const auto between = [&random](double low, double high) {
      return low + (high - low) * static_cast<double>(random() >> 11) * 0x1.0p-53;
    };
    height_ = std::pow(30.0, between(0.0, 1.0));                            // m, 1 to 30
    const double speed = between(0.3, 1.0) * std::min(8.0, 3.0 * height_);  // m/s, the highest
    metre_ = height_ / 600.0;
    const double turn = speed / (metre_ * std::hypot(900.0, 770.0));
    along_ = {turn, between(0.0, 6.28)};
    across_ = {1.1 * turn, between(0.0, 6.28)};
    rise_ = {between(0.3, 0.9), between(0.0, 6.28)};
    yaw_ = {between(0.4, 1.0), between(0.0, 6.28)};
    yaw_size_ = between(10.0, 60.0) / yaw_.rate * kDegree;
    pitch_ = {between(0.5, 1.2), between(0.0, 6.28)};
    roll_ = {between(0.5, 1.2), between(0.0, 6.28)};
    tilt_ = between(5.0, 25.0) / std::sqrt(2.0) * kDegree;
  }

  double height() const { return height_; }

  /// Ground: the map's plane, metres, z up.
  motion::CameraPose pose(double t) const {
    using Eigen::AngleAxisd;
    using Eigen::Vector3d;
    motion::CameraPose pose;
    pose.axes = AngleAxisd(yaw_size_ * yaw_.at(t), Vector3d::UnitZ()).toRotationMatrix() *
                Vector3d(1.0, -1.0, -1.0).asDiagonal() *
                AngleAxisd(tilt_ * pitch_.at(t), Vector3d::UnitX()).toRotationMatrix() *
                AngleAxisd(tilt_ * roll_.at(t), Vector3d::UnitY()).toRotationMatrix();
    pose.position << 900.0 * metre_ * along_.at(t), 700.0 * metre_ * across_.at(t),
        height_ * (1.0 + 0.2 * rise_.at(t));
    return pose;
  }

  Eigen::Matrix3d imageFromMap(double t) const {
    const double middle = 0.5 * demo::kMapSize * metre_;
    return camera() * motion::imageFromGround(pose(t)) *
           test::cameraMatrix(metre_, -metre_, -middle, middle);
  }

  static Eigen::Matrix3d camera() {
    return test::cameraMatrix(demo::kFocalLength, demo::kFocalLength, 0.5 * (demo::kImageWidth - 1),
                              0.5 * (demo::kImageHeight - 1));
  }

 private:
  static constexpr double kDegree = 3.14159265358979323846 / 180.0;
  struct Wave {
    double rate = 0.0;
    double phase = 0.0;
    double at(double t) const { return std::sin(rate * t + phase); }
  };

  double height_, metre_, yaw_size_, tilt_;
  Wave along_, across_, rise_, yaw_, pitch_, roll_;
};

using metrics::median;
using motion::CameraPose;
using motion::Vector6;

/// A homography of a flight; the numbers of the frames are their times.
struct Link {
  std::int32_t reference = -1;  // none found
  double homography[9] = {};
  double covariance[64] = {};
  double plane_deviation = 0.0;
};
using Links = std::vector<Link>;

constexpr double kRate = demo::kFrameRate;
using RowMajor3 = Eigen::Matrix<double, 3, 3, Eigen::RowMajor>;
using RowMajor8 = Eigen::Matrix<double, 8, 8, Eigen::RowMajor>;

/// Ground that rises and falls by 5 % of the height in all, around the plane.
double relief(const ExactFlight& flight, double x, double y) {
  const double size = 0.35 * flight.height();
  return 0.0125 * flight.height() * (std::sin(x / size) + std::sin(y / size + 1.0));
}

/// A picture of the ground with relief. Where a ray meets the ground is found on every eighth
/// pixel; in between the height of the ground is smooth.
cv::Mat pictureOfRelief(const cv::Mat& map, const ExactFlight& flight, double t) {
  constexpr int kStep = 8;
  const CameraPose pose = flight.pose(t);
  const Eigen::Matrix3d rays = pose.axes * ExactFlight::camera().inverse();
  const double metre = flight.height() / 600.0;
  const cv::Size size(2 * demo::kImageWidth, 2 * demo::kImageHeight);
  const auto ray_at = [&](int u, int v) -> Eigen::Vector3d {
    return rays * Eigen::Vector3d(0.5 * u - 0.25, 0.5 * v - 0.25, 1.0);
  };
  const auto met = [&](const Eigen::Vector3d& ray, double ground) -> Eigen::Vector3d {
    return pose.position + (ground - pose.position.z()) / ray.z() * ray;
  };
  cv::Mat coarse(size.height / kStep + 1, size.width / kStep + 1, CV_64F);
  for (int v = 0; v < coarse.rows; ++v) {
    for (int u = 0; u < coarse.cols; ++u) {
      double ground = 0.0;
      for (int step = 0; step < 8; ++step) {
        const Eigen::Vector3d point = met(ray_at(kStep * u, kStep * v), ground);
        ground = relief(flight, point.x(), point.y());
      }
      coarse.at<double>(v, u) = ground;
    }
  }
  cv::Mat columns(size, CV_32F), rows(size, CV_32F);
  for (int v = 0; v < size.height; ++v) {
    const double* above = coarse.ptr<double>(v / kStep);
    const double* below = coarse.ptr<double>(v / kStep + 1);
    const double down = static_cast<double>(v % kStep) / kStep;
    for (int u = 0; u < size.width; ++u) {
      const double right = static_cast<double>(u % kStep) / kStep;
      const int i = u / kStep;
      const double ground = (1.0 - down) * ((1.0 - right) * above[i] + right * above[i + 1]) +
                            down * ((1.0 - right) * below[i] + right * below[i + 1]);
      const Eigen::Vector3d point = met(ray_at(u, v), ground);
      columns.at<float>(v, u) = static_cast<float>(0.5 * demo::kMapSize + point.x() / metre);
      rows.at<float>(v, u) = static_cast<float>(0.5 * demo::kMapSize - point.y() / metre);
    }
  }
  cv::Mat large, image;
  cv::remap(map, large, columns, rows, cv::INTER_LINEAR, cv::BORDER_REFLECT_101);
  cv::resize(large, image, cv::Size(), 0.5, 0.5, cv::INTER_AREA);
  return image;
}

/// The time of the demo with the light of time `t`: the demo's changing light lasts from 5 s to
/// 6.7 s, here it goes there and back.
double timeOfLight(double t) {
  constexpr double kLength = 10.0 / 6.0;
  const double phase = std::fmod(t, 2.0 * kLength);
  return 5.0 + (phase < kLength ? phase : 2.0 * kLength - phase);
}

/// As the demo's, without the blurred part.
cv::Mat picture(const cv::Mat& map, const ExactFlight& flight, bool with_relief, int frame,
                int frames, std::uint64_t seed) {
  const double t = frame / kRate;
  cv::Mat image =
      with_relief ? pictureOfRelief(map, flight, t) : demo::render(map, flight.imageFromMap(t));
  const demo::Segment segment = demo::segmentOf(frame, frames);
  if (segment == demo::Segment::lighting) demo::changeLight(timeOfLight(t), image);
  if (segment == demo::Segment::noise)
    demo::addNoise(seed + static_cast<std::uint64_t>(frame), image);
  return image;
}

/// Corners followed from frame to frame, and a homography from the frame where they were found.
class FlowMatcher {
 public:
  Link match(const cv::Mat& image, int frame) {
    Link link;
    if (!points_.empty()) link = follow(image);
    if (link.reference < 0 || points_.size() < kCorners / 2) find(image, frame);
    last_ = image;
    return link;
  }

 private:
  static constexpr std::size_t kCorners = 500;

  void find(const cv::Mat& image, int frame) {
    cv::goodFeaturesToTrack(image, points_, kCorners, 0.01, 8.0);
    from_ = points_;
    reference_ = frame;
  }

  Link follow(const cv::Mat& image) {
    Link link;
    std::vector<cv::Point2f> next, back;
    std::vector<std::uint8_t> found, returned;
    cv::calcOpticalFlowPyrLK(last_, image, points_, next, found, cv::noArray());
    cv::calcOpticalFlowPyrLK(image, last_, next, back, returned, cv::noArray());
    std::vector<cv::Point2f> kept, from;
    for (std::size_t i = 0; i < next.size(); ++i) {
      const bool good = found[i] != 0 && returned[i] != 0 && cv::norm(back[i] - points_[i]) < 0.5;
      if (!good) continue;
      kept.push_back(next[i]);
      from.push_back(from_[i]);
    }
    points_ = kept;
    from_ = from;
    if (kept.size() < 12) return link;
    std::vector<std::uint8_t> inliers;
    const cv::Mat h = cv::findHomography(from, kept, cv::USAC_MAGSAC, 1.0, inliers, 2000, 0.999);
    if (h.empty()) return link;
    RowMajor3 found_h;
    cv::cv2eigen(h, found_h);
    found_h /= found_h(2, 2);
    Eigen::Matrix<double, 8, 8> information = Eigen::Matrix<double, 8, 8>::Zero();
    double squares = 0.0;
    double count = 0.0;
    for (std::size_t i = 0; i < kept.size(); ++i) {
      if (inliers[i] == 0) continue;
      const Eigen::Vector2d p(from[i].x, from[i].y);
      const auto slope = homography::jacobianByEntries(found_h, p);
      information += slope.transpose() * slope;
      squares +=
          (homography::project(found_h, p) - Eigen::Vector2d(kept[i].x, kept[i].y)).squaredNorm();
      count += 1.0;
    }
    if (count < 12.0) return link;
    link.reference = reference_;
    Eigen::Map<RowMajor3>(link.homography) = found_h;
    const Eigen::Matrix<double, 8, 1> scale = information.diagonal().cwiseSqrt().cwiseInverse();
    const Eigen::Matrix<double, 8, 8> scaled =
        (scale.asDiagonal() * information * scale.asDiagonal());
    Eigen::Map<RowMajor8>(link.covariance) =
        squares / (2.0 * count - 8.0) *
        (scale.asDiagonal() * scaled.inverse() * scale.asDiagonal());
    return link;
  }

  cv::Mat last_;
  std::vector<cv::Point2f> points_;
  std::vector<cv::Point2f> from_;
  int reference_ = -1;
};

Link linkOf(const SequenceMatch& found) {
  Link link;
  if (found.match.status != Status::ok) return link;
  link.reference = static_cast<std::int32_t>(
      std::lround(1e-9 * static_cast<double>(found.reference->stamp) * kRate));
  Eigen::Map<RowMajor3>(link.homography) = found.match.answer.homography;
  Eigen::Map<RowMajor8>(link.covariance) = found.match.answer.covariance;
  link.plane_deviation = found.match.answer.plane_deviation;
  return link;
}

void render(const cv::Mat& map, std::uint64_t seed, int frames, bool with_relief, Links& ours,
            Links& flow) {
  const ExactFlight flight(seed);
  SequenceOptions options;
  options.reference.mode = ReferenceMode::keyframe;
  options.matcher.guided.enabled = true;
  SequenceMatcher matcher(options);
  FlowMatcher flow_matcher;
  for (int frame = 0; frame < frames; ++frame) {
    const cv::Mat image = picture(map, flight, with_relief, frame, frames, 1000 * seed);
    ours.push_back(linkOf(matcher.match(image, frame / kRate)));
    flow.push_back(flow_matcher.match(image, frame));
  }
}

bool load(const std::string& path, int frames, Links& links) {
  std::ifstream file(path, std::ios::binary);
  links.resize(static_cast<std::size_t>(frames));
  const auto bytes = static_cast<std::streamsize>(links.size() * sizeof(Link));
  file.read(reinterpret_cast<char*>(links.data()), bytes);
  return file.gcount() == bytes;
}

void save(const std::string& path, const Links& links) {
  std::ofstream file(path, std::ios::binary);
  file.write(reinterpret_cast<const char*>(links.data()),
             static_cast<std::streamsize>(links.size() * sizeof(Link)));
}

struct Noise {
  double range = 0.0;  // share of the height
  double tilt = 0.0;   // rad
  double turn = 0.0;   // noise of a gyroscope, rad from frame to frame; 0: there is none
};

struct Score {
  double drift = 0.0;            // at the end, share of the way
  double velocity_error = 0.0;   // root mean square, m/s
  double bound = 0.0;            // 0.3 % of the speed (root mean square) and 2 mm/s
  double nees = 0.0;             // mean
  double held = 0.0;             // share within the 99.9 % bound
  double bias = 0.0;             // mean velocity error along the motion, share of the speed
  double pose_nees = 0.0;        // normalised error squared of x and y at the end
  double lost = 0.0;             // share of frames without a twist
  double microseconds = 0.0;     // per frame
  double plane_deviation = 0.0;  // median, px
};

CameraPose baseOf(const CameraPose& camera) {
  return {camera.axes * test::downward().linear().transpose(), camera.position};
}

Score score(std::uint64_t seed, const Links& links, const Noise& noise) {
  const ExactFlight flight(seed);
  std::mt19937_64 random(seed + 77);
  std::normal_distribution<double> normal;
  GroundMotion ground(test::optionsWith(test::downward()));
  Score score;
  double way = 0.0, speeds = 0.0, along = 0.0, count = 0.0;
  std::vector<double> deviations;
  std::optional<CameraPose> origin;
  CameraPose last;
  CameraPose found;
  Eigen::Matrix2d found_covariance = Eigen::Matrix2d::Identity();
  for (std::size_t i = 0; i < links.size(); ++i) {
    const CameraPose truth = flight.pose(static_cast<double>(i) / kRate);
    const CameraPose base = baseOf(truth);
    GroundFrame frame;
    frame.stamp = static_cast<std::int64_t>(std::llround(1e9 * static_cast<double>(i) / kRate));
    frame.camera = ExactFlight::camera();
    if (links[i].reference >= 0) {
      frame.reference_stamp =
          static_cast<std::int64_t>(std::llround(1e9 * links[i].reference / kRate));
      frame.answer = UncertainHomography{Eigen::Map<const RowMajor3>(links[i].homography),
                                         Eigen::Map<const RowMajor8>(links[i].covariance),
                                         Covariance8::Zero(), links[i].plane_deviation};
      deviations.push_back(links[i].plane_deviation);
    }
    const double metres = truth.position.z();
    frame.height =
        HeightReading{metres * (1.0 + noise.range * normal(random)), noise.range * metres};
    const auto shaken = [&](double deviation) {
      const double x = normal(random), y = normal(random);
      return motion::rotationAbout(deviation * Eigen::Vector3d(x, y, normal(random)));
    };
    const Eigen::Vector3d down = shaken(noise.tilt) * -truth.axes.row(2).transpose();
    frame.down = DownReading{down.normalized(), noise.tilt};
    if (noise.turn > 0.0 && i > 0) {
      const CameraPose before = flight.pose(static_cast<double>(i - 1) / kRate);
      frame.turn =
          TurnReading{before.axes.transpose() * truth.axes * shaken(noise.turn), noise.turn};
    }
    const auto start = std::chrono::steady_clock::now();
    const GroundEstimate& estimate = ground.add(frame);
    score.microseconds +=
        std::chrono::duration<double, std::micro>(std::chrono::steady_clock::now() - start)
            .count() /
        static_cast<double>(links.size());
    if (origin) way += (base.position - last.position).norm();
    if (estimate.hasPose()) {
      if (!origin) origin = base;
      found.position = estimate.base_to_odometry.translation();
      found_covariance = estimate.pose_covariance.topLeftCorner<2, 2>();
    }
    if (estimate.hasTwist()) {
      const Vector6 wanted = kRate * motion::constantTwist(last, base);
      const Eigen::Vector3d error = estimate.twist.head<3>() - wanted.head<3>();
      const Eigen::Matrix3d covariance = estimate.twist_covariance.topLeftCorner<3, 3>();
      const double nees = error.dot(covariance.inverse() * error);
      score.velocity_error += error.squaredNorm();
      score.nees += nees;
      score.held += nees < 16.266 ? 1.0 : 0.0;
      speeds += wanted.head<3>().squaredNorm();
      along += error.dot(wanted.head<3>());
      count += 1.0;
    }
    if (std::getenv("KTGP_ORB_SHOW") != nullptr && !estimate.hasTwist()) {
      std::printf("frame %zu: %s, height %.1f down %.1f deviations\n", i, toString(estimate.status),
                  estimate.height_misfit, estimate.down_misfit);
    }
    last = base;
  }
  if (!origin || count == 0.0) return score;
  const double yaw = std::atan2(origin->axes(1, 0), origin->axes(0, 0));
  const Eigen::Matrix3d turn = motion::rotationAbout(-yaw * Eigen::Vector3d::UnitZ());
  Eigen::Vector3d wanted = turn * (last.position - origin->position);
  wanted.z() = last.position.z();
  const Eigen::Vector3d error = found.position - wanted;
  score.drift = error.norm() / way;
  score.pose_nees = error.head<2>().dot(found_covariance.inverse() * error.head<2>());
  score.bias = along / speeds;
  score.bound = 0.003 * std::sqrt(speeds / count) + 0.002;
  score.velocity_error = std::sqrt(score.velocity_error / count);
  score.nees /= count;
  score.held /= count;
  score.lost = 1.0 - count / static_cast<double>(links.size());
  score.plane_deviation = median(deviations);
  return score;
}

struct Table {
  std::vector<Score> scores;
  std::vector<double> of(const std::function<double(const Score&)>& value) const {
    std::vector<double> values;
    for (const Score& each : scores) values.push_back(value(each));
    return values;
  }
  double worst(const std::function<double(const Score&)>& value) const {
    const std::vector<double> values = of(value);
    return *std::max_element(values.begin(), values.end());
  }
  double mean(const std::function<double(const Score&)>& value) const {
    double sum = 0.0;
    for (const double each : of(value)) sum += each;
    return sum / static_cast<double>(scores.size());
  }
};

void print(const char* name, const Table& table, bool details) {
  const auto drift = [](const Score& s) { return 100.0 * s.drift; };
  const auto error = [](const Score& s) { return s.velocity_error / s.bound; };
  std::printf(
      "| %s | %.3f %% | %.3f %% | %.2f | %.2f | %.2f | %.1f %% | %+.2f %% | %.2f | %.1f %% | %.2f "
      "| %.0f |\n",
      name, median(table.of(drift)), table.worst(drift), median(table.of(error)),
      table.worst(error), table.mean(&Score::nees), 100.0 * table.mean(&Score::held),
      100.0 * table.mean(&Score::bias), table.mean(&Score::pose_nees),
      100.0 * table.mean(&Score::lost), table.mean(&Score::plane_deviation),
      median(table.of(&Score::microseconds)));
  if (!details) return;
  for (const Score& s : table.scores) {
    std::printf(
        "    drift %.3f %% velocity %.4f of %.4f m/s, nees %.2f held %.3f, bias %.5f, pose %.1f, "
        "lost %.3f plane %.2f\n",
        100.0 * s.drift, s.velocity_error, s.bound, s.nees, s.held, s.bias, s.pose_nees, s.lost,
        s.plane_deviation);
  }
}

/// Prints each bound that does not hold.
bool holds(const Table& exact, const Table& noisy, const Table& relief, const Table& noisy_relief) {
  bool all = true;
  const auto check = [&all](const char* what, double value, double low, double high) {
    if (value >= low && value <= high) return;
    std::printf("%s is %.4f; expected %.4f to %.4f\n", what, value, low, high);
    all = false;
  };
  check("drift, median", median(exact.of(&Score::drift)), 0.0, 0.001);
  check("drift, worst", exact.worst(&Score::drift), 0.0, 0.003);
  check("drift with noise, worst", noisy.worst(&Score::drift), 0.0, 0.005);
  check("velocity error / bound, median",
        median(exact.of([](const Score& s) { return s.velocity_error / s.bound; })), 0.0, 1.0);
  check("normalised error squared", exact.mean(&Score::nees), 2.0, 4.0);
  check("normalised error squared with noise", noisy.mean(&Score::nees), 2.0, 4.0);
  check("99.9 % bound held", exact.mean(&Score::held), 0.98, 1.0);
  check("99.9 % bound held with noise", noisy.mean(&Score::held), 0.98, 1.0);
  check("relief: mean velocity error, share", relief.mean(&Score::bias), -0.003, 0.003);
  check("relief: 99.9 % bound held", relief.mean(&Score::held), 0.98, 1.0);
  check("relief with noise: velocity error / bound, worst",
        noisy_relief.worst([](const Score& s) { return s.velocity_error / s.bound; }), 0.0, 30.0);
  check("relief: plane_deviation, px", relief.mean(&Score::plane_deviation), 0.1, 10.0);
  check("flat: plane_deviation, px", exact.mean(&Score::plane_deviation), 0.0, 0.02);
  return all;
}

int run(int argc, char** argv) {
  if (argc < 4) {
    std::fprintf(stderr, "usage: motion_accuracy FOLDER FLIGHTS SECONDS [details]\n");
    return 2;
  }
  const std::string folder = argv[1];
  const int flights = std::atoi(argv[2]);
  const int frames = static_cast<int>(std::lround(std::atof(argv[3]) * kRate));
  std::filesystem::create_directories(folder);
  cv::setNumThreads(1);
  cv::Mat map;
  const auto linksOf = [&](int seed, bool with_relief, Links& ours, Links& flow) {
    const std::string path = folder + "/" + (with_relief ? "relief-" : "flat-") +
                             std::to_string(seed) + "-" + std::to_string(frames);
    if (load(path + "-ktgp", frames, ours) && load(path + "-flow", frames, flow)) return;
    if (map.empty()) cv::cvtColor(demo::drawMap(1), map, cv::COLOR_BGR2GRAY);
    ours.clear();
    flow.clear();
    render(map, static_cast<std::uint64_t>(seed), frames, with_relief, ours, flow);
    save(path + "-ktgp", ours);
    save(path + "-flow", flow);
  };
  const Noise exact;
  constexpr double kDegree = 3.14159265358979323846 / 180.0;
  const Noise noisy{0.01, 0.5 * kDegree};
  const Noise with_gyro{0.01, 0.5 * kDegree, 0.05 * kDegree / kRate};
  constexpr int kReliefs = 4;  // flights over relief
  Table tables[2][3];
  Table reliefs[2][2];
  for (int i = 0; i < flights; ++i) {
    const int seed = i + 1;
    Links links[2];
    linksOf(seed, false, links[0], links[1]);
    const auto add = [&](const Noise& noise, int method, Table& table) {
      table.scores.push_back(score(static_cast<std::uint64_t>(seed), links[method], noise));
    };
    for (int method = 0; method < 2; ++method) {
      add(exact, method, tables[method][0]);
      add(noisy, method, tables[method][1]);
      add(with_gyro, method, tables[method][2]);
    }
    if (i >= kReliefs) continue;
    linksOf(seed, true, links[0], links[1]);
    for (int method = 0; method < 2; ++method) {
      add(exact, method, reliefs[method][0]);
      add(noisy, method, reliefs[method][1]);
    }
  }
  const bool details = argc > 4;
  std::printf(
      "| | drift, median | worst | velocity error / bound, median | worst | normalised error "
      "squared | "
      "99.9 %% bound held | mean error along the way | of x and y at the end (2) | no velocity | "
      "plane_deviation, px | µs |\n"
      "|---|---:|---:|---:|---:|---:|---:|---:|---:|---:|---:|---:|\n");
  const char* const names[] = {"ktgp_orb", "PyrLK and MAGSAC++"};
  for (int method = 0; method < 2; ++method) {
    const std::string name = names[method];
    print((name + ", true height and tilt").c_str(), tables[method][0], details);
    print((name + ", 1 % and 0.5° noise").c_str(), tables[method][1], details);
    print((name + ", the same with a gyroscope").c_str(), tables[method][2], details);
    print((name + ", relief of 5 %, true height and tilt").c_str(), reliefs[method][0], details);
    print((name + ", relief of 5 %, noise").c_str(), reliefs[method][1], details);
  }
  return holds(tables[0][0], tables[0][1], reliefs[0][0], reliefs[0][1]) ? 0 : 1;
}

}  // namespace
}  // namespace ktgp_orb

int main(int argc, char** argv) {
  return ktgp_orb::run(argc, argv);
}
