#pragma once

#include <pybind11/eigen.h>
#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>

#include <Eigen/Core>
#include <cstdint>
#include <map>
#include <opencv2/core.hpp>
#include <optional>
#include <string>
#include <vector>

#include "ktgp_orb/ktgp_matcher.h"

namespace ktgp_orb::python {

namespace py = pybind11;

struct Motion {
  std::string geometry;
  Eigen::Matrix3d rotation;
  Eigen::Vector3d translation;
  std::optional<Covariance6> covariance;
};

/// The result for a pair of images, with the arrays that Python programs get. The arrays have a row
/// for each correspondence of the four stages, followed by a row for each correspondence that
/// guided matching or growth added.
struct Match {
  struct Stage {
    std::string name;
    std::size_t input = 0;
    std::size_t output = 0;
    double milliseconds = 0.0;
  };

  Match() = default;
  /// Copies the values of `result` and the positions of the features. `input`: contains the camera
  /// matrices, from which the scene points are triangulated.
  Match(const MatchResult& result, const Features& reference, const Features& target,
        const TwoViewInput& input = {});

  /// Returns true if a homography was found. A scene with depth has none.
  bool hasHomography() const { return status == "ok" && geometry != "epipolar"; }

  std::string status;
  std::string found_by;
  UncertainHomography answer;
  std::size_t inlier_count = 0;
  double rmse = 0.0;
  std::string geometry;
  std::string doubt;
  std::optional<Motion> motion;
  std::optional<Motion> other;
  std::optional<Eigen::Matrix3d> fundamental;
  /// Numbers of the two-view geometry; the keys are the names that two_view::visitNumbers gives
  /// them.
  std::map<std::string, double> numbers;
  std::vector<Eigen::Vector3d> points;
  std::vector<double> point_deviations;
  std::vector<std::int32_t> point_matches;
  std::vector<Stage> stages;
  std::vector<Eigen::Vector2d> reference_points;
  std::vector<Eigen::Vector2d> target_points;
  std::vector<std::int32_t> reference_indices;
  std::vector<std::int32_t> target_indices;
  std::vector<std::int32_t> distances;
  std::vector<std::uint8_t> levels;

 private:
  void addPoints(const MatchResult& result, const TwoViewInput& input);
};

/// The result for a frame of a sequence.
struct FrameMatch : Match {
  using Match::Match;
  bool repeated = false;
  std::string no_reference;
  std::optional<Eigen::Matrix3d> accumulated;
  std::int64_t stamp = 0;  ///< ns
  std::int64_t reference_stamp = 0;
  cv::Size image_size;
  cv::Size reference_size;            ///< px; empty if there is no reference
  std::vector<std::uint64_t> tracks;  ///< for each match: track number of its target keypoint
};

/// The number of seconds nearest to the stamp; a product with 1e-9 would be off in its last digit.
inline double secondsOf(std::int64_t stamp) {
  return static_cast<double>(stamp) / 1e9;
}

/// stateOf() converts a match to its state for pickle, and restore() converts it back.
py::tuple stateOf(const Match& match);
void restore(const py::tuple& state, Match& match);

/// Registers the classes and functions for pairs of images.
void definePairs(py::module& module);
void defineSequence(py::module& module);
/// Registers the classes for targets, mosaic, stabilizer and motion above the ground.
void defineConsumers(py::module& module);

}  // namespace ktgp_orb::python
