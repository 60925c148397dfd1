#pragma once

#include <array>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <vector>

#include "ktgp_orb/sequence_matcher.h"

namespace ktgp_orb::evaluation {

/// One frame matched to the previous frame.
struct FrameScore {
  double time = 0.0;  ///< s since the first frame
  Status status = Status::no_reference;
  std::size_t keypoints = 0;
  std::array<std::size_t, 4> matches{};  ///< after knn, tf, gms, prosac
  Search search = Search::whole;
  double inlier_ratio =
      0.0;  ///< share of the matches after the ratio filter that are final; 0 if there are none
  double rmse = 0.0;                   ///< error of the inliers, px
  double milliseconds = 0.0;           ///< features of this frame and all stages
  std::optional<double> corner_error;  ///< corner error of this frame, px; if the truth is known
  std::optional<double> drift;         ///< error of the chain since the window's start, px
};

struct SequenceScore {
  std::vector<FrameScore> frames;
  /// Element k-1: among the keypoints with a match to the next frame, the share that is matched
  /// without a gap over k frames. Element 0 is 1.
  std::vector<double> survival;
};

/// Runs the four stages on consecutive frames and collects the statistics.
class SequenceEvaluator {
 public:
  /// Drift is accumulated over `window` frames, then restarts; 0: over all frames.
  SequenceEvaluator(const OrbOptions& orb, const MatcherOptions& matcher, int window);

  /// `stamp` in s: if it goes back, the sequence restarts; a gap does not matter. `image`: 8-bit
  /// grey. `truth`: homography from the previous frame to this frame, if known.
  void addFrame(double stamp, const cv::Mat& image, const std::optional<Eigen::Matrix3d>& truth);

  SequenceScore score() const;

 private:
  void followTracks(const SequenceMatch& match);
  void accumulateDrift(const SequenceMatch& match, const std::optional<Eigen::Matrix3d>& truth,
                       FrameScore& frame);

  SequenceMatcher matcher_;
  int window_;
  double first_stamp_ = 0.0;
  std::vector<FrameScore> frames_;

  std::vector<int> track_length_;  ///< track length of each keypoint of the newest frame
  /// Per frame: element k-1 counts its keypoints with a track of at least k matches.
  std::vector<std::vector<std::size_t>> long_tracks_;

  int frames_in_window_ = 0;
  Eigen::Matrix3d estimated_ = Eigen::Matrix3d::Identity();
  Eigen::Matrix3d true_ = Eigen::Matrix3d::Identity();
};

nlohmann::json toJson(const SequenceScore& score);

}  // namespace ktgp_orb::evaluation
