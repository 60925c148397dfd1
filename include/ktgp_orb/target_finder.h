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

/// A flat object to find, described by pictures of it.
struct Target {
  std::string id;  ///< unique and not empty
  /// One or more 8-bit grey images. Each shows the whole object and nothing else, for example one
  /// by day and one by night.
  std::vector<cv::Mat> images;
  double width = 0.0;  ///< width of the flat object in the images, m; 0: not known
  /// Name of the target's frame in tf, for the caller; a leading slash is removed. It must differ
  /// from the frames of all other targets and of their instances (FRAME_1 ...).
  std::string frame;
};

struct TargetFinderOptions {
  /// Options of the features of frames and targets. By default there are more keypoints than usual,
  /// in every part of the frame, because a target may be small. There are more pyramid levels
  /// (targets use five), because a target may be three times as large as in its image.
  OrbOptions orb = [] {
    OrbOptions options;
    options.max_features = 3300;
    options.levels = 10;
    options.distribution = KeypointDistribution::uniform;
    return options;
  }();
  int features =
      500;  ///< limit of keypoints per target image, 50..5000; five times that with views
  int largest_side = 400;  ///< larger target images are shrunk to this to save memory, px, 64..4000
  /// Number of views in which each image of a target is searched. 1: the image itself at full, half
  /// and quarter size; 5: also four views of it with a tilt of 2, each at these sizes.
  int views = 5;
  /// Shorter side of the smallest targets to find in the frame, px, 40..1000. Only whether it is
  /// below 80 matters: then the frame is enlarged before the extraction, and about half of the
  /// targets of 45 px are found. The factor is two, unless the frame would be longer than 2500 px;
  /// below a factor of 1.25 it is not enlarged. A frame below 480 px is enlarged by up to four: at
  /// 160 px, half of the targets of 18 px are found. Enlarging multiplies the time. Frames are
  /// enlarged if no target or a small one is followed, if one was lost, and every eighth time.
  double smallest_side = 45.0;
  /// Time for targets that were not seen in the last frame, ms per frame; a tenth of it while other
  /// targets are followed. If infinite, all candidates are tried on every frame. A part of the
  /// keypoints is always looked up, and two candidates are always tried. The extraction and the
  /// targets of the last frame take additional time.
  double search_ms = std::numeric_limits<double>::infinity();
  int max_instances = 8;  ///< maximum number of copies of one target in a frame, 1..1000
};

/// A target that was found in a frame.
struct DetectedTarget {
  std::string id;
  int instance = 0;  ///< number from 0; an object keeps its number while it is followed
  /// ok, or model_rejected: another target with more or similar support is at the same place, or
  /// around the part of this target that was found. Only one of the two can be there.
  Status status = Status::ok;
  std::size_t image = 0;  ///< index of the image of the target that was found
  cv::Size image_size;    ///< size of that image, px
  double width = 0.0;     ///< Target::width
  std::string frame;      ///< Target::frame
  /// Says in which other pose the target's picture looks the same, such as "turned by 180 degrees".
  /// The reported pose is then one of several. Empty if there is no such pose.
  std::string ambiguity;
  /// Positions in the frame of the centres of the four corner pixels of the target's image: upper
  /// left, upper right, lower right, lower left; px.
  std::array<Eigen::Vector2d, 4> corners;
  std::array<Eigen::Matrix<double, 2, 2, Eigen::DontAlign>, 4> corner_covariances;  ///< px²
  /// Homography from the target's image to the frame, px, with its covariance.
  UncertainHomography homography;
  bool aligned = false;     ///< the homography comes from patches of the images, not from keypoints
  std::size_t inliers = 0;  ///< keypoints that agree with the homography
  double log_false_alarms = 0.0;  ///< log10 of the expected number of false alarms
  int age = 0;  ///< number of successive frames that show this instance, this one included
  /// If true, the keypoints of the target were not found, but the frame looks like its picture near
  /// the predicted position. This relies on the previous frame, so a false alarm is more likely.
  bool predicted = false;
  /// Pairs that the homography was fitted to: positions in the target's image and in the frame, px.
  PointPairs pairs;
};

/// Result for one frame; valid until the next call.
struct TargetFrame {
  /// Ordered by id, then by instance.
  std::vector<DetectedTarget> detections;

  // Counts of the search.
  std::size_t known = 0;       ///< number of known targets
  std::size_t candidates = 0;  ///< targets with some keypoints whose pairs agree with each other
  std::size_t tried = 0;       ///< number of candidates that were tried
  /// Number of frames in which all keypoints are looked up in the index and every candidate is
  /// tried, if it remains a candidate; 1 if this frame sufficed.
  std::size_t frames_for_all = 1;
  /// A target of which max_instances were found, so that there may be more copies; empty: none.
  std::string at_limit;
  std::size_t features = 0;  ///< keypoints of the frame
  double extraction_milliseconds = 0.0;
  double milliseconds = 0.0;  ///< extraction and search
};

/// Finds many flat targets in the frames of a camera.
///
/// 1. The frame's features are extracted once.
/// 2. For each keypoint of the frame, an index of the descriptors of all targets returns the most
///    similar keypoints (bits sampled at random in several tables; Indyk & Motwani, STOC 1998). A
///    pair of keypoints predicts an affine map, since keypoints have a direction and a size. The
///    targets whose pairs agree with each other are candidates.
/// 3. Each candidate, and each target of the last frame, is matched separately (multi-index
///    hashing).
/// 4. A homography grows from the best pairs, by keypoints or by the grey values around a pair. The
///    grey values of both images must confirm it; if they are inconclusive, the test with decoys
///    must (see HomographyGrowth). Then it is aligned to a fraction of a pixel, and more copies of
///    the target are searched in the remaining keypoints.
///
/// The targets of the last frame come first. Then search_ms limits how many keypoints are looked up
/// in the index and how many candidates are tried. Successive frames look up different keypoints.
/// The candidates are in turn the best supported and the longest untried. So the time decides what
/// is tried. Whether a tried target is found depends on earlier frames only through the enlargement
/// of the frame (smallest_side) and targets followed by the images alone
/// (DetectedTarget::predicted).
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
  /// image or an image of another type, a width that is negative or not finite, an image with too
  /// little texture, an image that cannot be told apart from another target, and a frame that
  /// collides with the frame of another target.
  void add(const Target& target);
  /// Adds the target in place of the one with this id, which must exist.
  void replace(const Target& target);
  /// False if there is no such target.
  bool remove(const std::string& id);
  /// The ids of all targets, in the order in which the targets were added.
  std::vector<std::string> ids() const;
  bool knows(const std::string& id) const;
  /// DetectedTarget::ambiguity of the target with this id; empty if there is no such target.
  std::string ambiguity(const std::string& id) const;

  /// `image`: 8-bit grey; otherwise std::invalid_argument.
  const TargetFrame& find(const cv::Mat& image);
  /// Searches in features that were extracted elsewhere; if they have no images, there is no
  /// alignment. Throws as requireValid does, and for another kind of descriptors.
  const TargetFrame& find(const Features& features);

  /// Searches all targets in an image outside the sequence. The followed targets do not change.
  const TargetFrame& findAlone(const cv::Mat& image);

  /// Forgets all followed targets, because the next frame belongs to another sequence.
  void restart();

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

/// Draws the outlines and ids of the targets found in `image` (yellow; purple if the status is not
/// ok). A short line marks the upper left corner of each target. Throws as drawOverlay does.
void drawTargets(const cv::Mat& image, const std::vector<DetectedTarget>& detections,
                 cv::Mat& canvas);

}  // namespace ktgp_orb
