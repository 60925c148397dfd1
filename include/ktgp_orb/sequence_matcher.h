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

/// Choice of the frame that a frame is matched to.
enum class ReferenceMode : std::uint8_t {
  previous,  ///< the previous frame, as in the paper
  keyframe,  ///< one frame while it overlaps and gives enough matches: less drift
  fixed,     ///< one frame set by the caller: tracking of a planar target
};

struct ReferenceOptions {
  ReferenceMode mode = ReferenceMode::previous;
  double max_age = 1.0;  ///< s between the previous frame and this one, > 0; not used in fixed mode
  double min_overlap = 0.5;  ///< keyframe: share of the target image that it must cover, 0..1
  int min_inliers = 100;     ///< keyframe: final matches that it must give, >= 4
  /// fixed: if the shorter side of the reference is below this, px, its features and those of the
  /// frames are also searched in larger copies (OrbOptions::first_level): up to four times as
  /// large, and at most 2500 px long. Not with TEBLID. 0: never. OpenCV makes the copies, with its
  /// own threads and a little memory for each frame.
  int enlarge_below = 0;
};

/// Options of the extractor, of the stages and of the reference. The defaults are the paper's
/// method, for neighbouring frames. A fixed reference is seen from anywhere, and needs
/// MatcherOptions::robust() with GrowthOptions::views of 13, and 5000 features of a uniform
/// KeypointDistribution.
struct SequenceOptions {
  OrbOptions orb;
  MatcherOptions matcher;
  ReferenceOptions reference;
  /// fixed: the views of the reference (GrowthOptions::views) are made in a thread of their own,
  /// and frames are matched without them until they are ready. Off: the first frame waits for them,
  /// which takes seconds for a large reference, and results do not depend on time.
  bool views_in_background = false;
};

/// The simulated views of a fixed reference, see GrowthOptions::views.
enum class ViewsState : std::uint8_t {
  none,        ///< there are none: they are not wanted, or no frame has needed them yet
  being_made,  ///< frames are matched without them
  ready,
};

/// The enumerator's own name, e.g. "being_made".
const char* toString(ViewsState state);

/// `options` as the sequence needs them: `orb.images` is shared with alignment and none without,
/// and growth is off in mode previous, since a video does not need it. SequenceMatcher applies it.
/// Use the same options when you extract features elsewhere. (Where a small fixed reference is
/// enlarged, the features are found again.)
SequenceOptions withImages(SequenceOptions options);

/// Why a frame had no reference. The numbers are those of the REASON_ constants in the messages.
enum class NoReference : std::uint8_t {
  none = 0,         ///< there was a reference
  first_frame = 1,  ///< there was no previous frame
  gap = 2,          ///< the previous frame is older than max_age
  /// The previous frame is newer. A single frame is left out, and the next one has the reference
  /// that it would have had; two that follow each other are a looped recording.
  stamp_went_back = 3,
  size_changed = 4,      ///< the previous frame has another width or height
  encoding_changed = 5,  ///< the previous frame has another encoding
  not_set = 6,           ///< fixed mode without a reference
  reset = 7,             ///< reset() was called since the previous frame
  mode_changed = 8,      ///< the reference mode was changed since the previous frame
  lens_changed = 9,      ///< the previous frame has another lens, or none
};

/// The enumerator's own name, e.g. "stamp_went_back".
const char* toString(NoReference reason);

/// An image of the sequence and its features.
struct Frame {
  std::int64_t stamp = 0;  ///< time of the image, ns since any epoch
  std::string encoding;    ///< the caller's name of the camera's pixel format; may be empty
  cv::Mat image;           ///< CV_8UC1; empty if the caller has only the features
  /// CV_8UC1, the size of `image`: keypoints are found where it is not zero. Empty: everywhere.
  cv::Mat mask;
  /// If set, the keypoints are moved to their positions without distortion. There is no sub-pixel
  /// alignment then, since the image is still distorted. Null: the keypoints stay.
  LensConstPtr lens;
  /// K of the image without distortion, px, for the two-view geometry; empty: not known.
  std::optional<Eigen::Matrix3d> camera;
  /// Moves points of `image` to the pixels of `camera`; null: they are there.
  LensConstPtr camera_lens;
  Features features;
  /// A track number, >= 1, for each keypoint: a final match continues the track of its reference
  /// keypoint; every other keypoint begins a new track. Set by SequenceMatcher::match; empty
  /// before.
  std::vector<std::uint64_t> tracks;
  /// Options that `features` were found with. If the matcher needs others, the features
  /// are found again in a new frame of the same image; this frame does not change. Without an image
  /// the features are used as they are.
  std::optional<OrbOptions> orb;
  double extraction_milliseconds = 0.0;
  /// Keeps the pixels of `image` alive where it does not own them (for example a message).
  std::shared_ptr<const void> source;
};

using FramePtr = std::shared_ptr<Frame>;
using FrameConstPtr = std::shared_ptr<const Frame>;

/// Finds the features of `frame.image` with its mask and lens; stores the options and the time.
void extractFeatures(OrbExtractor& extractor, Frame& frame);

/// The result for one frame.
struct SequenceMatch {
  /// The target: the given frame, or a new one of its image (see Frame::orb).
  FrameConstPtr frame;
  FrameConstPtr reference;                       ///< null: none, see `no_reference`
  NoReference no_reference = NoReference::none;  ///< none: there was a reference
  /// The image repeats the one before, with the same pixels or compressed anew, as drivers and
  /// videos with a doubled rate do. It is no new frame: everything else is still that of the frame
  /// before, `frame` as well. Images of a camera that stands still are new frames: those that stay
  /// the same for longer than images took to change, or, where none did, than 0.1 s.
  bool repeated = false;
  bool reference_changed = false;  ///< it differs from the reference of the previous frame
  MatchResult match;               ///< status no_reference, all empty without one
  /// From the first frame of an unbroken sequence to this one; empty at its start, in fixed mode
  /// and without a homography. The covariance is propagated to first order: noise adds up in
  /// squares, smooth errors linearly. (The keypoint errors of a frame enter two of the multiplied
  /// homographies with opposite signs, so this is rather too large.) It is NaN if that of one
  /// of them is. The deviation from a plane is the largest of them.
  std::optional<UncertainHomography> accumulated;
  std::int64_t first_stamp = 0;  ///< with `accumulated`: of that first frame, ns
  /// Number of frames so far whose search near the prediction failed (Search::fell_back); see
  /// KnnOptions::search_radius.
  std::uint64_t fall_backs = 0;
  /// Extraction and all stages, including those of matches that were not used.
  double total_milliseconds = 0.0;
};

/// Whether a match needs only the features of its two frames: not the motion or the answer of the
/// frame before (search radius, two-view geometry), nor the views of the reference (growth).
bool canMatchAhead(const MatcherOptions& options);

/// A match computed in advance, for example in another thread, to save time later.
struct MatchAhead {
  FrameConstPtr reference;
  MatchResult result;
};

/// Matches the frames of a camera one after the other. Chooses the reference of each frame, and
/// multiplies the homographies. It forgets a reference that cannot belong to the same sequence as
/// the next frame; NoReference lists the cases.
///
/// With growth (GrowthOptions) and in fixed mode, the views of the reference are simulated before
/// its first match. In keyframe and fixed mode, a frame for which PROSAC finds no homography takes
/// longer; the number of seeds bounds the work.
///
/// With a search radius (KnnOptions), matches are searched near the positions that the motion
/// between the last two frames predicts. If that gives no homography, or less than half of the
/// inliers of the previous frame, the frame is matched again over the whole image, and the better
/// result counts.
///
/// An instance belongs to one thread at a time. In the steady state nothing is allocated, unless
/// frames are enlarged (ReferenceOptions::enlarge_below).
class SequenceMatcher {
 public:
  /// Throws std::invalid_argument naming the option and its range.
  explicit SequenceMatcher(const SequenceOptions& options = {});
  ~SequenceMatcher();
  SequenceMatcher(SequenceMatcher&&) noexcept;
  SequenceMatcher& operator=(SequenceMatcher&&) noexcept;

  /// The given options, except for the images (see withImages).
  const SequenceOptions& options() const;
  /// Applies from the next frame on. Another mode forgets the reference, but not a fixed one.
  /// Throws as the constructor does, without any change.
  void setOptions(const SequenceOptions& options);

  /// Matches the next image, taken at `seconds` since any epoch. `image`: 8-bit grey; it is copied.
  /// `encoding`: the camera's pixel format; a change starts a new sequence. The result is valid
  /// until the next call. Throws std::invalid_argument, without any change, for an image of another
  /// type and for a time that is not finite or more than 292 years from zero.
  const SequenceMatch& match(const cv::Mat& image, double seconds,
                             const std::string& encoding = {});
  /// Matches features found elsewhere. Throws as requireValid does.
  const SequenceMatch& match(const Features& features, double seconds);
  /// Matches a frame, which is kept without a copy: do not change it until its use_count() is
  /// 1 again. If `ahead` is not null, it is used instead of a new match to the reference that it
  /// names, if canMatchAhead says so.
  const SequenceMatch& match(const FramePtr& frame, MatchAhead* ahead = nullptr);

  /// An empty frame to fill for match() or setFixedReference(). Frames that are no longer in use
  /// are returned here, with their buffers.
  FramePtr newFrame();

  /// Sets the reference of the fixed mode; null: none. If `frame` has no features yet, they are
  /// extracted at once in fixed mode, and in other modes when a frame first needs them.
  void setFixedReference(const FramePtr& frame);
  FrameConstPtr fixedReference() const;
  /// As of the last frame.
  ViewsState viewsState() const;
  /// The next frame becomes the fixed reference; the frame after it is the first to be matched.
  void fixNextFrame();

  /// The next frame is the first of a new sequence; a fixed reference stays.
  void restart();
  /// Forgets every reference, including the fixed one and a call of fixNextFrame().
  void reset();

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace ktgp_orb
