#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <memory>
#include <opencv2/core.hpp>
#include <optional>
#include <string>

#include "ktgp_orb/features.h"
#include "ktgp_orb/ktgp_matcher.h"
#include "ktgp_orb/lens.h"
#include "ktgp_orb/orb_extractor.h"

namespace ktgp_orb {

/// How the reference of a frame is chosen.
enum class ReferenceMode : std::uint8_t {
  previous,  ///< the previous frame, as in the paper
  /// An earlier frame. It stays the reference as long as it overlaps the present frame and gives
  /// enough matches; this reduces drift.
  keyframe,
  fixed,  ///< a frame that the caller sets, to track a planar target
};

struct ReferenceOptions {
  ReferenceMode mode = ReferenceMode::previous;
  /// Maximum time since the previous frame, s, > 0; after a longer gap, a frame has no reference
  /// (NoReference::gap). Not used in mode fixed.
  double max_age = 1.0;
  /// A keyframe must cover this share of the target image to stay the reference, 0..1.
  double min_overlap = 0.5;
  /// A keyframe stays the reference only if it gives at least this number of final matches, >= 4.
  int min_inliers = 100;
  /// Only in mode fixed: if the shorter side of the reference is below this limit (px), ORB also
  /// extracts features from enlarged copies of the reference and of each frame
  /// (OrbOptions::first_level). The copies are enlarged up to four times, to at most 2500 px on the
  /// longer side. Has no effect with TEBLID, or if the limit is 0. OpenCV computes the copies; it
  /// uses its own threads and allocates a little memory for each frame.
  int enlarge_below = 0;
};

/// Options of the feature extraction, of the matching and of the choice of the reference. The
/// defaults are the paper's method, which was designed for neighbouring frames. A fixed reference
/// may be seen from any viewpoint, so it needs MatcherOptions::robust() with 13
/// GrowthOptions::views, and 5000 features with KeypointDistribution::uniform.
struct SequenceOptions {
  OrbOptions orb;
  MatcherOptions matcher;
  ReferenceOptions reference;
  /// For mode fixed. If true, the views of the reference (GrowthOptions::views) are simulated in a
  /// separate thread, and frames are matched without views until the views are ready. If false, the
  /// first frame waits for the views, which takes seconds for a large reference, but the results do
  /// not depend on timing.
  bool views_in_background = false;
};

/// State of the simulated views of a fixed reference, see GrowthOptions::views.
enum class ViewsState : std::uint8_t {
  none,        ///< there are no views: none are wanted, or no frame has needed them yet
  being_made,  ///< the views are still being made; until then, frames are matched without views
  ready,
};

/// Returns the enumerator's name, e.g. "being_made".
const char* toString(ViewsState state);

/// Returns the options as SequenceMatcher uses them: `orb.images` becomes share if alignment is on,
/// otherwise none. In mode previous, growth is switched off, since a video does not need it. If you
/// extract features elsewhere, pass your options through this function, too. (If SequenceMatcher
/// enlarges a small fixed reference, it extracts the features again.)
SequenceOptions withImages(SequenceOptions options);

/// Why a frame had no reference. The values equal the REASON_ constants in the messages.
enum class NoReference : std::uint8_t {
  none = 0,         ///< there was a reference
  first_frame = 1,  ///< there was no previous frame
  gap = 2,          ///< the previous frame is older than max_age
  /// The previous frame has a newer stamp. If only one frame has an older stamp, it is skipped, and
  /// the next frame is matched as if the skipped frame did not exist. Two such frames in a row mean
  /// that the recording was looped.
  stamp_went_back = 3,
  size_changed = 4,  ///< the previous frame has another width or height
  /// The previous frame has another encoding or, if it has no image, another kind of descriptors.
  encoding_changed = 5,
  not_set = 6,       ///< mode fixed, but no reference was set
  reset = 7,         ///< reset() was called since the previous frame
  mode_changed = 8,  ///< the reference mode was changed since the previous frame
  lens_changed = 9,  ///< the previous frame has another lens, or only one of the frames has a lens
};

/// Returns the enumerator's name, e.g. "stamp_went_back".
const char* toString(NoReference reason);

/// What a frame is made from.
struct FrameInput {
  std::int64_t stamp = 0;  ///< time of the image, ns since any epoch
  /// Name that the caller gives to the camera's pixel format; may be empty.
  std::string encoding;
  cv::Mat image;  ///< CV_8UC1; empty if the caller has only the features
  /// CV_8UC1, the size of `image`: keypoints are found where the mask is not zero, or everywhere if
  /// it is empty.
  cv::Mat mask;
  /// If set, extractFeatures() moves the keypoints to their positions in an image without lens
  /// distortion. There is then no sub-pixel alignment, because the image itself is still distorted.
  /// If null, the keypoints stay where they are.
  LensConstPtr lens;
  /// Camera matrix K of the image without lens distortion, px, for the two-view geometry; empty if
  /// it is not known.
  std::optional<Eigen::Matrix3d> camera;
  /// For the two-view geometry: maps the keypoints to the image without distortion, to which
  /// `camera` refers; null if they are already positions in that image.
  LensConstPtr camera_lens;
};

/// An image of the sequence and its features.
struct Frame : FrameInput {
  Features features;
  /// A track number, >= 1, for each keypoint: a final match continues the track of its reference
  /// keypoint; every other keypoint begins a new track. SequenceMatcher::match sets the numbers;
  /// before that, the list is empty.
  std::vector<std::uint64_t> tracks;
  /// Options with which `features` were extracted. If the matcher needs other options, it extracts
  /// the features again into a new frame of the same image, and this frame does not change. Without
  /// an image, the features are used as they are.
  std::optional<OrbOptions> orb;
  double extraction_milliseconds = 0.0;
  /// Owner of the pixels of `image` (for example a message) if `image` does not own them.
  std::shared_ptr<const void> source;
};

using FramePtr = std::shared_ptr<Frame>;
using FrameConstPtr = std::shared_ptr<const Frame>;

/// Finds the features of `frame.image`, using `frame.mask` and `frame.lens`. Stores the options and
/// the duration in `frame`, too.
void extractFeatures(OrbExtractor& extractor, Frame& frame);

/// The result for one frame.
struct SequenceMatch {
  /// The target: the given frame, or a new frame with the same image (see Frame::orb).
  FrameConstPtr frame;
  /// Null if there was no reference; see `no_reference`.
  FrameConstPtr reference;
  NoReference no_reference = NoReference::none;  ///< reason why `reference` is null
  /// True if the image only repeats the previous image: its pixels are the same, or they differ
  /// only because the image was compressed again. Some drivers, and videos with a doubled frame
  /// rate, repeat images. A repeated image is not a new frame: all other fields, including `frame`,
  /// keep the result of the previous frame. If an image stays the same for longer than earlier
  /// images took to change (or for 0.1 s if no image has changed yet), the camera stands still.
  /// From then on, equal images count as new frames. But if equal images have alternated with new
  /// ones three times, they are repetitions as long as there are not more in a row than before.
  bool repeated = false;
  bool reference_changed = false;  ///< the previous frame had another reference
  MatchResult match;               ///< empty and with status no_reference if there is no reference
  /// Homography from the first frame of an unbroken sequence to this frame; empty at the start, in
  /// fixed mode and without a homography. The covariance is propagated to first order: the
  /// variances of the noise add up, and so do the standard deviations of the smooth errors
  /// (UncertainHomography::shared_covariance). (The covariance is too large, because it ignores
  /// that the keypoint errors of a frame enter two of the multiplied homographies with opposite
  /// signs.) It is NaN if a covariance in the chain is NaN. Its plane_deviation is the largest
  /// plane_deviation in the chain.
  std::optional<UncertainHomography> accumulated;
  std::int64_t first_stamp = 0;  ///< stamp of the first frame of `accumulated`, ns
  /// Number of frames so far for which the search near the predicted positions failed
  /// (Search::fell_back); see KnnOptions::search_radius.
  std::uint64_t fall_backs = 0;
  /// Time of the extraction and of all stages, including matches whose result was discarded.
  double total_milliseconds = 0.0;
};

/// Returns true if two frames can be matched in advance, from their features alone. This is not
/// possible with a search radius or two-view geometry, because these use results of the previous
/// frame, nor with GrowthOptions::views, because growth may need the views of the reference.
bool canMatchAhead(const MatcherOptions& options);

/// A match that was computed in advance, for example in another thread, to save time later.
struct MatchAhead {
  FrameConstPtr reference;
  MatchResult result;
};

/// Matches the frames of a camera one after the other. Chooses the reference of each frame, and
/// multiplies the homographies from frame to frame. If the reference cannot belong to the same
/// sequence as the next frame, it is dropped; NoReference lists the cases.
///
/// In fixed mode with growth and GrowthOptions::views, the views of the reference are simulated
/// when the first frame is matched to it (see SequenceOptions::views_in_background). In keyframe
/// and fixed mode, a frame for which PROSAC finds no homography takes longer, because growth runs;
/// the number of seeds limits this time.
///
/// With a search radius (KnnOptions), matches are searched near the positions that the motion
/// between the last two frames predicts. If that gives no homography, or less than half as many
/// inliers as the previous frame had, the frame is matched again over the whole image, and the
/// better result counts.
///
/// An instance belongs to one thread at a time. After the first frames, no memory is allocated,
/// unless frames are enlarged (ReferenceOptions::enlarge_below).
class SequenceMatcher {
 public:
  /// Throws std::invalid_argument, naming the option and its range, if an option is out of range.
  explicit SequenceMatcher(const SequenceOptions& options = {});
  ~SequenceMatcher();
  SequenceMatcher(SequenceMatcher&&) noexcept;
  SequenceMatcher& operator=(SequenceMatcher&&) noexcept;

  /// The options that the caller gave, changed by withImages().
  const SequenceOptions& options() const;
  /// The new options apply from the next frame on. If the mode changes, the reference is dropped
  /// unless it is a fixed reference. Throws like the constructor; in that case, the old options
  /// stay.
  void setOptions(const SequenceOptions& options);

  /// Matches the next image, taken at `seconds` since any epoch. `image`: 8-bit grey; it is copied.
  /// `encoding`: the camera's pixel format; a new sequence starts if it changes. The result is
  /// valid until the next call. Throws std::invalid_argument, without any change, for an image of
  /// another type, and for a time that is not finite or does not fit into 64 bits of ns (292
  /// years).
  const SequenceMatch& match(const cv::Mat& image, double seconds,
                             const std::string& encoding = {});
  /// Matches features that were extracted elsewhere; Features::images are shared, not copied.
  /// Throws like requireValid, and for a time that the function above refuses.
  const SequenceMatch& match(const Features& features, double seconds);
  /// Matches a frame. The frame is kept, not copied: do not change it until its use_count() is 1
  /// again. Uses the result in `ahead` instead of matching again if canMatchAhead() is true for the
  /// options and ahead->reference is the reference of this frame.
  const SequenceMatch& match(const FramePtr& frame, MatchAhead* ahead = nullptr);

  /// Returns an empty frame. Fill it and pass it to match() or setFixedReference(). It reuses the
  /// buffers of a frame that is no longer in use.
  FramePtr newFrame();

  /// Sets the reference of the fixed mode, or removes it (null). If `frame` has no features yet,
  /// they are extracted at once in fixed mode, and in other modes when a frame first needs them.
  /// Give it a stamp that no other frame and no other reference has, for example -1: FramePath and
  /// the classes that use it tell frames by their stamps.
  void setFixedReference(const FramePtr& frame);
  FrameConstPtr fixedReference() const;
  /// State of the views when the last frame was matched.
  ViewsState viewsState() const;
  /// Makes the next frame the fixed reference; the frame after it is the first to be matched.
  void fixNextFrame();

  /// Begins a new sequence with the next frame, but keeps a fixed reference and fixNextFrame().
  void restart();
  /// Forgets every reference, including the fixed one, and cancels fixNextFrame() if it was called
  /// since the last frame.
  void reset();

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace ktgp_orb
