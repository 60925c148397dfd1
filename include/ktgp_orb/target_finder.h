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

/// A flat object to find, described by images of it.
struct Target {
  std::string id;  ///< unique and not empty
  /// One or more 8-bit grey images. Each shows the whole object and nothing else, for example one
  /// by day and one by night.
  std::vector<cv::Mat> images;
  double width = 0.0;  ///< width of the flat object in the images, m; 0: not known
  /// Name of the target's frame in tf; TargetFinder only passes it on to the detections. A leading
  /// slash is removed. It must differ from the frames of all other targets and of their instances
  /// (FRAME_1 ...).
  std::string frame;
};

struct TargetFinderOptions {
  /// Options for extracting the features of frames and targets. By default, a frame gets more
  /// keypoints than usual, spread over all its parts, because a target may be small. A frame has
  /// more pyramid levels than a target (which has five), because the target may appear three times
  /// as large as in its image.
  OrbOptions orb = [] {
    OrbOptions options;
    options.max_features = 3300;
    options.levels = 10;
    options.distribution = KeypointDistribution::uniform;
    return options;
  }();
  /// Maximum number of keypoints of a target image at full size, 50..5000. The image at full, half
  /// and quarter size together gets up to twice this number, or up to six times if `views` is 5.
  int features = 500;
  /// Longest side of a target image, px, 64..4000; larger images are shrunk to save memory.
  int largest_side = 400;
  /// Number of views in which each image of a target is searched. 1: only the image itself, at
  /// full, half and quarter size. 5: also four views of the image with a tilt of 2 (compressed to
  /// half in one direction), each at these three sizes.
  int views = 5;
  /// Shorter side of the smallest targets to find in the frame, px, 40..1000. All values below 80
  /// have the same effect: frames are enlarged before the extraction, so that about half of the
  /// targets of 45 px are found. The factor is two, or less if the frame would become longer than
  /// 2500 px; if the factor would be below 1.25, the frame is not enlarged. Frames whose longer
  /// side is below 480 px are enlarged by a factor of up to four; in frames of 160 px, half of the
  /// targets of 18 px are found. Because an enlarged frame takes several times as long, a frame is
  /// enlarged only if no target is followed, if a small target is followed, or if a target was
  /// lost. In addition, every eighth frame is enlarged.
  double smallest_side = 45.0;
  /// Time per frame to search for targets that the last frame did not show, ms, >= 0. While other
  /// targets are followed, a tenth of this time is used. If infinite, all candidates are tried on
  /// every frame. Even if the time is too short, a part of the keypoints is looked up and two
  /// candidates are tried. The extraction and the targets of the last frame take additional time.
  double search_ms = std::numeric_limits<double>::infinity();
  int max_instances = 8;  ///< maximum number of copies of one target in a frame, 1..1000
};

/// A target that was found in a frame.
struct DetectedTarget {
  std::string id;
  int instance = 0;  ///< from 0; the same object keeps its number while it is followed
  /// Status::ok or model_rejected. A target is rejected if it is `uncertain`, or if another target
  /// with more or similar support is at the same place or encloses the part of this target that was
  /// found, since only one of the two can be there.
  Status status = Status::ok;
  /// True if the standard deviation of a corner is more than 5 px, both in the frame and in the
  /// target's image, because only a small part of the target was found or its position is
  /// inaccurate. Such a target is not followed and gets no instance number.
  bool uncertain = false;
  std::size_t image = 0;  ///< index in Target::images of the image that was found
  cv::Size image_size;    ///< size of that image, px
  double width = 0.0;     ///< Target::width
  std::string frame;      ///< Target::frame
  /// Describes another pose in which the target's image looks the same, e.g. "turned by 180
  /// degrees". The reported pose is then one of several possible poses. Empty if there is only one.
  std::string ambiguity;
  /// Where the centres of the four corner pixels of the target's image are in the frame, px: upper
  /// left, upper right, lower right, lower left.
  std::array<Eigen::Vector2d, 4> corners;
  std::array<Eigen::Matrix<double, 2, 2, Eigen::DontAlign>, 4> corner_covariances;  ///< px²
  /// Homography from the target's image to the frame, px, with its covariance.
  UncertainHomography homography;
  /// True if the homography comes from aligned patches of the images, not from keypoints.
  bool aligned = false;
  std::size_t inliers = 0;        ///< number of keypoints that agree with the homography
  double log_false_alarms = 0.0;  ///< log10 of the expected number of false alarms
  int age = 0;  ///< number of successive frames that show this instance, including this frame
  /// If true, the keypoints of the target were not found, but at the predicted position the frame
  /// looks like the target's image. The prediction relies on the previous frame, so a false alarm
  /// is more likely.
  bool predicted = false;
  /// Pairs that the homography was fitted to: positions in the target's image and in the frame, px.
  PointPairs pairs;
};

/// Result for one frame; valid until the next call.
struct TargetFrame {
  /// The detected targets, ordered by id, then by instance.
  std::vector<DetectedTarget> detections;

  // Statistics of the search.
  std::size_t known = 0;  ///< number of known targets
  /// Number of targets that the last frame showed, plus other targets with some pairs of keypoints
  /// that agree with each other.
  std::size_t candidates = 0;
  std::size_t tried = 0;  ///< number of candidates that were searched for in this frame
  /// Estimated number of frames that are needed to look up all keypoints in the index, at the pace
  /// of this frame, plus one frame for each candidate that was not tried. 1 if this frame was
  /// enough.
  std::size_t frames_for_all = 1;
  /// Id of a target of which max_instances copies were found: the frame may show more copies of it.
  /// Empty if there is no such target.
  std::string at_limit;
  std::size_t features = 0;  ///< number of keypoints in the frame
  double extraction_milliseconds = 0.0;
  double milliseconds = 0.0;  ///< time of the extraction and the search
};

/// Finds many flat targets in the frames of a camera.
///
/// 1. The frame's features are extracted once.
/// 2. For each keypoint of the frame, an index of the descriptors of all targets returns the most
///    similar keypoints of the targets (several tables with randomly sampled bits as keys; Indyk &
///    Motwani, STOC 1998). Each such pair of keypoints predicts an affine map from target to frame,
///    since keypoints have a direction and a size. The targets whose pairs agree with each other
///    are candidates.
/// 3. Each candidate, and each target of the last frame, is matched separately (multi-index
///    hashing).
/// 4. A homography grows from the best pairs, using more keypoints or the grey values around a
///    pair. The grey values of both images must confirm the homography; if they are inconclusive,
///    the test with decoys must confirm it (see HomographyGrowth). Then the homography is aligned
///    to a fraction of a pixel, and more copies of the target are searched for among the remaining
///    keypoints.
///
/// The targets of the last frame come first. Then search_ms limits how many keypoints are looked up
/// in the index and how many candidates are tried. Successive frames look up different keypoints.
/// The search alternates between the candidate with the best support and the candidate that has not
/// been tried for the longest time. So the available time decides which candidates are tried. For a
/// target that is tried, earlier frames influence in only two ways whether it is found: they
/// determine whether the frame is enlarged (smallest_side), and a target may be followed without
/// keypoints (DetectedTarget::predicted).
///
/// An instance belongs to one thread at a time.
class TargetFinder {
 public:
  /// Throws std::invalid_argument, naming the option and its range, if an option is out of range.
  explicit TargetFinder(const TargetFinderOptions& options = {});
  ~TargetFinder();
  TargetFinder(TargetFinder&&) noexcept;
  TargetFinder& operator=(TargetFinder&&) noexcept;

  const TargetFinderOptions& options() const;
  /// Changes three of the TargetFinderOptions from the next frame on. Throws like the constructor;
  /// in that case, the old values stay.
  void setSearch(double search_ms, double smallest_side, int max_instances);

  /// Adds a target. Throws std::invalid_argument with the reason, without any change, for an empty
  /// id, the id of a known target, no image or an image of another type, a width that is negative
  /// or not finite, an image with too little texture, an image that cannot be told apart from
  /// another target, and a tf frame whose name collides with the tf frames of another target or its
  /// instances.
  void add(const Target& target);
  /// Replaces the target with the same id, which must exist.
  void replace(const Target& target);
  /// Removes a target. Returns false if there is no target with this id.
  bool remove(const std::string& id);
  /// The ids of all targets, in the order in which the targets were added.
  std::vector<std::string> ids() const;
  bool knows(const std::string& id) const;
  /// Returns the text for DetectedTarget::ambiguity of the target with this id; empty if there is
  /// no such target.
  std::string ambiguity(const std::string& id) const;

  /// Searches for the targets in the next frame. `image`: 8-bit grey; other types throw
  /// std::invalid_argument.
  const TargetFrame& find(const cv::Mat& image);
  /// Searches in features that were extracted elsewhere; without Features::images, there is no
  /// alignment. Throws like requireValid, and if the features have another kind of descriptors than
  /// the targets.
  const TargetFrame& find(const Features& features);

  /// Searches for all targets in an image that does not belong to the sequence. The targets that
  /// are being followed do not change.
  const TargetFrame& findAlone(const cv::Mat& image);

  /// Call this if the next frame belongs to another sequence. Forgets all followed targets.
  void restart();

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

/// Draws the outlines and ids of the targets found in `image` (yellow; purple if the status is not
/// ok). A short line marks the upper left corner of each target. Throws in the same cases as
/// drawOverlay.
void drawTargets(const cv::Mat& image, const std::vector<DetectedTarget>& detections,
                 cv::Mat& canvas);

}  // namespace ktgp_orb
