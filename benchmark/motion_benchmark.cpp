// Measures the time that motion in metres adds to a frame: GroundMotion::add with a height and a
// normal in every frame, exact homographies of a flight, and a new keyframe every ten frames.

#include <benchmark/benchmark.h>

#include <Eigen/LU>
#include <cmath>
#include <vector>

#include "ktgp_orb/ground_motion.h"
#include "main.h"
#include "motion/camera_pose.h"

namespace {

using ktgp_orb::GroundFrame;
using ktgp_orb::motion::CameraPose;

constexpr int kFrames = 300;

CameraPose poseAt(double t) {
  CameraPose pose;
  pose.axes =
      ktgp_orb::motion::rotationAbout({0.2 * std::sin(t), 0.1 * std::sin(1.3 * t), 0.3 * t}) *
      Eigen::Vector3d(1.0, -1.0, -1.0).asDiagonal();
  pose.position << 2.0 * t, std::sin(0.7 * t), 4.0 + 0.5 * std::sin(0.5 * t);
  return pose;
}

std::vector<GroundFrame> flight() {
  Eigen::Matrix3d camera;
  camera << 525.0, 0.0, 319.5, 0.0, 525.0, 239.5, 0.0, 0.0, 1.0;
  ktgp_orb::Covariance8 covariance = ktgp_orb::Covariance8::Zero();
  covariance.diagonal() << 1e-9, 1e-9, 1e-4, 1e-9, 1e-9, 1e-4, 1e-14, 1e-14;
  std::vector<GroundFrame> frames(kFrames);
  for (int i = 0; i < kFrames; ++i) {
    const int reference = i == 0 ? 0 : (i - 1) / 10 * 10;
    const CameraPose pose = poseAt(i / 30.0);
    const CameraPose before = poseAt(reference / 30.0);
    GroundFrame& frame = frames[static_cast<std::size_t>(i)];
    frame.stamp = std::llround(1e9 * i / 30.0);
    frame.reference_stamp = std::llround(1e9 * reference / 30.0);
    frame.camera = camera;
    if (reference != i) {
      frame.answer.emplace();
      frame.answer->homography = camera * ktgp_orb::motion::imageFromGround(pose) *
                                 ktgp_orb::motion::imageFromGround(before).inverse() *
                                 camera.inverse();
      frame.answer->covariance = covariance;
    }
    frame.height = ktgp_orb::HeightReading{pose.position.z(), 0.01, 0.0};
    frame.down = ktgp_orb::DownReading{-pose.axes.row(2).transpose(), 0.01};
  }
  return frames;
}

void motion(benchmark::State& state) {
  const std::vector<GroundFrame> frames = flight();
  ktgp_orb::GroundMotion ground;
  std::size_t next = 0;
  for (auto _ : state) {
    if (next == frames.size()) {
      next = 0;
      ground = ktgp_orb::GroundMotion();
    }
    const ktgp_orb::GroundEstimate& estimate = ground.add(frames[next++]);
    if (next > 2 && !estimate.hasTwist()) state.SkipWithError(toString(estimate.status));
    benchmark::DoNotOptimize(estimate);
  }
}
BENCHMARK(motion)->Unit(benchmark::kMicrosecond);

}  // namespace

int main(int argc, char** argv) {
  return ktgp_orb::bench::run(argc, argv);
}
