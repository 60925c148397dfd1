#pragma once

#include <Eigen/Core>
#include <array>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <memory>
#include <opencv2/core.hpp>
#include <string>
#include <vector>

#include "ktgp_orb/features.h"
#include "ktgp_orb/orb_extractor.h"
#include "ktgp_orb/prosac_homography.h"
#include "ktgp_orb/status.h"

namespace ktgp_orb {

/// A flat object that is known by pictures of it.
struct Target {
  std::string id;  ///< not empty; no other target has it
  /// 8-bit grey, one or more. Each shows the whole object and nothing else, in its own way (for
  /// example by day and by night).
  std::vector<cv::Mat> images;
  double width = 0.0;  ///< width of the flat object in the images, m; 0: not known
  /// Name for the caller (tf), without a leading slash, which is left out. No other target has it,
  /// also not as FRAME_1 ... of its instances.
  std::string frame;
};

struct TargetFinderOptions {
  /// Options of the features of frames and targets. By default more keypoints than usual, and in
  /// every part of the frame: a target may be small. Also more pyramid levels (targets use five of
  /// them): a target may be three times as large as in its image.
  OrbOptions orb = [] {
    OrbOptions options;
    options.max_features = 3300;
    options.levels = 10;
    options.distribution = KeypointDistribution::uniform;
    return options;
  }();
  int features =
      500;  ///< most keypoints of an image of a target, 50..5000; its views have five times as many
  int largest_side = 400;  ///< px, 64..4000; larger images of targets are made smaller, for memory
  /// Images that each image of a target is searched as: 1: itself, at full, half and quarter size;
  /// 5: also four views of it with a tilt of 2, at all these sizes.
  int views = 5;
  /// Shorter side of the smallest targets in the frame that are wanted, px, 40..1000. It only
  /// matters whether it is below 80. Then the frame is made larger before the extraction: about
  /// half of the targets of 45 px are found. It is made twice as large, but at most 2500 px long,
  /// and not if this is less than 1.25 times as large. A frame below 480 px is made up to four
  /// times as large: in one of 160 px half of the targets of 18 px are found. This takes a multiple
  /// of the time, so it is done while nothing is followed, or something small, or something was
  /// lost, and in each eighth frame.
  double smallest_side = 45.0;
  /// Time for the targets that were not seen in the last frame, ms per frame; a tenth of it while
  /// other targets are followed. Infinite: all that have a chance are tried on every frame. A part
  /// of the index and one target are always searched. The extraction and the targets of the last
  /// frame come on top.
  double search_ms = std::numeric_limits<double>::infinity();
  int max_instances = 8;  ///< maximum number of copies of one target in a frame, 1..1000
};

/// A target in a frame.
struct DetectedTarget {
  std::string id;
  int instance = 0;  ///< from 0; the same object keeps its number while it is followed
  /// ok; or model_rejected: another target, with more or similar support, is at the same place or
  /// around the part of this target that was found. Only one of the two can be there. Or it is
  /// `uncertain`.
  Status status = Status::ok;
  /// The target was found, but so little of it, or so badly, that a corner has a standard deviation
  /// of more than 5 px. It is not followed, and has no number of its own.
  bool uncertain = false;
  std::size_t image = 0;  ///< the image of the target that was found
  cv::Size image_size;    ///< size of that image, px
  double width = 0.0;     ///< Target::width
  std::string frame;      ///< Target::frame
  /// How its picture looks like itself in another pose, such as "turned by 180 degrees": then this
  /// pose is one of several. Empty: it does not.
  std::string ambiguity;
  /// The centres of the four corner pixels of the target's image in the frame: upper left, upper
  /// right, lower right, lower left; px.
  std::array<Eigen::Vector2d, 4> corners;
  std::array<Eigen::Matrix<double, 2, 2, Eigen::DontAlign>, 4> corner_covariances;  ///< px²
  /// Image of the target -> frame, px, with its covariance (see UncertainHomography).
  UncertainHomography homography;
  bool aligned = false;     ///< the homography comes from patches of the images, not from keypoints
  std::size_t inliers = 0;  ///< keypoints that agree with it
  double log_false_alarms = 0.0;  ///< log10 of the expected number of false alarms
  int age = 0;  ///< frames in which this instance was seen one after the other, this one included
  /// Its keypoints were not found, but the image looks like its picture near the predicted
  /// position. Rests on the frame before; the chance of a false alarm is larger.
  bool predicted = false;
  /// Pairs that the homography was fitted to: positions in the target's image and in the frame, px.
  PointPairs pairs;
};

/// Result for one frame; valid until the next call.
struct TargetFrame {
  /// Ordered by id, then by instance.
  std::vector<DetectedTarget> detections;

  // Counts of the search.
  std::size_t known = 0;       ///< targets
  std::size_t candidates = 0;  ///< targets with a chance: some keypoints that fit together
  std::size_t tried = 0;       ///< number of these targets that were tried
  /// Frames within which all keypoints are looked up in the index and every candidate is tried, if
  /// it stays one: 1 if this was done.
  std::size_t frames_for_all = 1;
  /// A target of which max_instances were found, so that there may be more; empty: none.
  std::string at_limit;
  std::size_t features = 0;  ///< keypoints of the frame
  double extraction_milliseconds = 0.0;
  double milliseconds = 0.0;  ///< extraction and search
};

/// Finds many flat targets in the frames of a camera.
///
/// 1. The frame's features are extracted once.
/// 2. An index of the descriptors of all targets (bits sampled at random in several tables; Indyk &
///   Motwani, STOC 1998) gives for each keypoint of the frame the most similar ones. A pair of
///   keypoints predicts an affine map, since it has a direction and a size. The targets whose pairs
///   agree with each other are candidates.
/// 3. Each candidate, and each target of the last frame, is matched with the frame by itself
///   (multi-index hashing).
/// 4. The best pairs grow to a homography, by keypoints or by the grey values around a pair. The
///   grey values of both images must confirm it or, where they do not tell, decoys of the keypoints
///   (see HomographyGrowth). It is aligned to a fraction of a pixel, and the target is searched
///   again in the other keypoints.
///
/// The targets of the last frame come first. Then search_ms limits how many keypoints are looked up
/// in the index, in turn, and how many candidates are tried: in order of their support, each second
/// one in turn. What is tried depends on this time. What is found does not, apart from two things
/// that depend on what was seen before: whether the frame is made larger (smallest_side), and what
/// is followed by the images alone (DetectedTarget::predicted).
///
/// An instance belongs to one thread at a time.
class TargetFinder {
 public:
  /// Throws std::invalid_argument naming the option and its range.
  explicit TargetFinder(const TargetFinderOptions& options = {});
  ~TargetFinder();
  TargetFinder(TargetFinder&&) noexcept;
  TargetFinder& operator=(TargetFinder&&) noexcept;

  const TargetFinderOptions& options() const;
  /// Sets these TargetFinderOptions from the next frame on. Throws as the constructor does, without
  /// any change.
  void setSearch(double search_ms, double smallest_side, int max_instances);

  /// Throws std::invalid_argument with the reason, without any change, for an empty or known id, no
  /// image or one of another type, a width that is negative or not finite, an image with too little
  /// texture, one that shows the same as another target, so that the two could not be told apart,
  /// and a frame that meets another target's.
  void add(const Target& target);
  /// Adds the target in place of the one with this id, which must exist.
  void replace(const Target& target);
  /// False if there is no such target.
  bool remove(const std::string& id);
  /// In the order in which they were added.
  std::vector<std::string> ids() const;
  bool knows(const std::string& id) const;
  /// DetectedTarget::ambiguity of the target with this id; empty if there is no such target.
  std::string ambiguity(const std::string& id) const;

  /// `image`: 8-bit grey; otherwise std::invalid_argument.
  const TargetFrame& find(const cv::Mat& image);
  /// Searches in features found elsewhere; without images there is no alignment. Throws as
  /// requireValid does, and for descriptors of another kind.
  const TargetFrame& find(const Features& features);

  /// Searches all targets in an image that does not belong to the frames: what is followed there
  /// stays as it is.
  const TargetFrame& findAlone(const cv::Mat& image);

  /// Forgets what was seen: the next frame belongs to another sequence.
  void restart();

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

/// Draws the outlines and ids of the targets found in `image` (yellow; purple: not status ok). A
/// short line marks the upper left corner of each. Throws as drawOverlay.
void drawTargets(const cv::Mat& image, const std::vector<DetectedTarget>& detections,
                 cv::Mat& canvas);

}  // namespace ktgp_orb
