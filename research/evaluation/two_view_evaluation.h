#pragma once

#include <Eigen/Core>
#include <array>
#include <cstddef>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "evaluation/dataset.h"
#include "evaluation/method_steps.h"
#include "parameters/options.h"

/// Evaluation of the relative pose of two views of scenes with depth.
namespace ktgp_orb::evaluation::two_view {

/// Limits of the error for the area under the curve, degrees.
constexpr std::array<double, 4> kPoseThresholds{1.0, 2.0, 5.0, 10.0};
/// A match is right if its Sampson distance from the true epipolar geometry is below this, px. If
/// the camera only turned: its distance from the position that the turn gives.
constexpr double kRightWithin = 1.5;

/// Two images with known cameras: x_target ~ R x_reference + t.
struct PosePair {
  std::string set;        ///< folder and distance, e.g. "kitti_2, 3 apart"
  std::string name;       ///< the two files
  std::string reference;  ///< image file
  std::string target;
  Eigen::Matrix3d reference_camera;  ///< K, px
  Eigen::Matrix3d target_camera;
  Eigen::Matrix3d rotation;
  Eigen::Vector3d translation;  ///< unit vector; zero if the camera only turned

  bool onlyTurns() const { return translation.isZero(0.0); }
};

/// The pairs that pairs.txt of `folder` lists by row numbers, from 0. Without that file, the images
/// that are `apart` rows from each other in cameras.txt. This file has one row per image, `file fx
/// fy cx cy R11 R12 ... R33 t1 t2 t3`, with x_camera = R X + t. Throws FileError, also for a
/// distance or a pairs.txt without a pair. `dataset` gets the name of the set and those of all
/// files of the folder; after an error, the names that are known by then.
std::vector<PosePair> findPosePairs(const std::string& folder, const std::vector<int>& apart,
                                    Dataset& dataset);

/// The result of one method for one pair.
struct PoseScore {
  bool found = false;
  std::string geometry;  ///< see Geometry; peers: empty
  /// The larger of the errors of rotation and of the translation's direction, degrees; infinite
  /// without a pose.
  double error = 0.0;
  double milliseconds = 0.0;             ///< matching and estimation, without the features
  double estimation_milliseconds = 0.0;  ///< time of the geometry alone; peers: of the estimator
  std::size_t matches = 0;               ///< number of final matches
  double precision = 0.0;                ///< share of the final matches that are right
  /// Share of the right matches before the geometry stage that become final matches.
  double kept = 0.0;
  /// The larger deviation of rotation and direction by the answer's covariance, degrees.
  double deviation = 0.0;
  std::string doubt;  ///< see Doubt; peers: empty
  /// Squared error over its covariance; 5 degrees of freedom, or 3 if the camera only turned.
  std::optional<double> normalised;
  bool consistent = false;  ///< `normalised` is within the 99.9 % bound of these
};

/// Names of the methods: ours, and OpenCV's estimator on our matches and on OpenCV's own.
std::vector<std::string> methodNames();

/// Runs the given methods and reuses its buffers.
class PoseEvaluator {
 public:
  /// `options`: parameters of the preset slam. Throws std::invalid_argument for an unknown name.
  PoseEvaluator(const PipelineOptions& options, const std::vector<std::string>& methods);
  /// One score per method, in their order. Throws FileError, and std::invalid_argument for a K that
  /// does not fit the image.
  std::vector<PoseScore> evaluate(const PosePair& pair);

 private:
  OrbExtractor extractor_;
  Features reference_;
  Features target_;
  std::vector<std::function<PoseScore(const PosePair&, const Scene&)>> runs_;
};

/// A table for the terminal, with a row per set and method. `scores`: one list per pair.
std::string toTable(const std::vector<PosePair>& pairs,
                    const std::vector<std::vector<PoseScore>>& scores,
                    const std::vector<std::string>& methods);

/// One row per pair and method.
std::string toCsv(const std::vector<PosePair>& pairs,
                  const std::vector<std::vector<PoseScore>>& scores,
                  const std::vector<std::string>& methods);

}  // namespace ktgp_orb::evaluation::two_view
