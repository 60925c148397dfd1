#include "evaluation/sequence_evaluation.h"

#include <chrono>
#include <limits>
#include <nlohmann/json.hpp>

#include "ktgp_orb/metrics.h"
#include "util/milliseconds.h"

namespace ktgp_orb::evaluation {

namespace {

SequenceOptions optionsOf(const OrbOptions& orb, const MatcherOptions& matcher) {
  SequenceOptions options{orb, matcher, {}};
  options.reference.max_age = std::numeric_limits<double>::infinity();
  return options;
}

}  // namespace

SequenceEvaluator::SequenceEvaluator(const OrbOptions& orb, const MatcherOptions& matcher,
                                     int window)
    : matcher_(optionsOf(orb, matcher)), window_(window) {}

void SequenceEvaluator::addFrame(double stamp, const cv::Mat& image,
                                 const std::optional<Eigen::Matrix3d>& truth) {
  using Clock = std::chrono::steady_clock;
  if (frames_.empty()) first_stamp_ = stamp;
  const auto start = Clock::now();
  const SequenceMatch& match = matcher_.match(image, stamp);
  FrameScore frame;
  frame.milliseconds = util::millisecondsSince(start);
  frame.time = stamp - first_stamp_;
  frame.keypoints = match.frame->features.size();
  frame.status = match.match.homographyStatus();
  if (match.reference) {
    for (std::size_t i = 0; i < 4; ++i) frame.matches[i] = match.match.stages[i].output;
    frame.inlier_ratio = metrics::retention(frame.matches[3], frame.matches[1]);
    frame.rmse = match.match.rmse;
    frame.search = match.match.search;
  }
  accumulateDrift(match, truth, frame);
  followTracks(match);
  frames_.push_back(frame);
}

void SequenceEvaluator::followTracks(const SequenceMatch& match) {
  std::vector<int> length(match.frame->features.size(), 0);
  std::vector<std::size_t> counts;
  std::vector<bool> continued(track_length_.size(), false);
  for (const Correspondence& c : match.match.correspondences) {
    const auto r = static_cast<std::size_t>(c.reference_index);
    // If several matches share a keypoint, it continues one track.
    if (c.level < Level::ktgp || continued[r]) continue;
    continued[r] = true;
    const int matches = track_length_[r] + 1;
    length[static_cast<std::size_t>(c.target_index)] = matches;
    if (counts.size() < static_cast<std::size_t>(matches)) {
      counts.resize(static_cast<std::size_t>(matches));
    }
    for (int k = 0; k < matches; ++k) ++counts[static_cast<std::size_t>(k)];
  }
  track_length_ = std::move(length);
  long_tracks_.push_back(std::move(counts));
}

void SequenceEvaluator::accumulateDrift(const SequenceMatch& match,
                                        const std::optional<Eigen::Matrix3d>& truth,
                                        FrameScore& frame) {
  const cv::Size size = match.frame->features.image_size;
  const bool found = match.match.homographyStatus() == Status::ok;
  if (truth && found) {
    frame.corner_error = metrics::cornerError(match.match.answer.homography, *truth, size);
  }
  const bool window_is_full = window_ > 0 && frames_in_window_ >= window_;
  if (!truth || !found || window_is_full) {
    frames_in_window_ = 0;
    estimated_.setIdentity();
    true_.setIdentity();
  }
  if (!truth || !found) return;
  estimated_ = match.match.answer.homography * estimated_;
  true_ = *truth * true_;
  ++frames_in_window_;
  frame.drift = metrics::cornerError(estimated_, true_, size);
}

SequenceScore SequenceEvaluator::score() const {
  SequenceScore score;
  score.frames = frames_;
  // Tracks of k matches that end at frame t began at frame t - k. Tracks that begin too late to be
  // followed over k frames do not count.
  const std::size_t n = long_tracks_.size();
  const auto tracks = [&](std::size_t frame, std::size_t k) {
    return k <= long_tracks_[frame].size() ? long_tracks_[frame][k - 1] : 0;
  };
  for (std::size_t k = 1; k < n; ++k) {
    std::size_t begun = 0;
    std::size_t alive = 0;
    for (std::size_t end = k; end < n; ++end) {
      begun += tracks(end - k + 1, 1);
      alive += tracks(end, k);
    }
    score.survival.push_back(metrics::retention(alive, begun));
  }
  return score;
}

nlohmann::json toJson(const SequenceScore& score) {
  nlohmann::json out{{"survival", score.survival}, {"frames", nlohmann::json::array()}};
  for (const FrameScore& f : score.frames) {
    nlohmann::json frame{
        {"time", f.time},       {"status", toString(f.status)},   {"keypoints", f.keypoints},
        {"matches", f.matches}, {"inlier_ratio", f.inlier_ratio}, {"rmse", f.rmse},
        {"ms", f.milliseconds}};
    if (f.corner_error) frame["corner_error"] = *f.corner_error;
    if (f.drift) frame["drift"] = *f.drift;
    out["frames"].push_back(std::move(frame));
  }
  return out;
}

}  // namespace ktgp_orb::evaluation
