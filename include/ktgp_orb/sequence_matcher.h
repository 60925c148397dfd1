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
  keyframe,  ///< the same frame while it overlaps and gives enough matches; this reduces drift
  fixed,     ///< a frame that the caller sets, to track a planar target
};

struct ReferenceOptions {
  ReferenceMode mode = ReferenceMode::previous;
  double max_age = 1.0;      ///< limit of the time since the previous frame, s, > 0; not for fixed
  double min_overlap = 0.5;  ///< share of the target image that a keyframe must cover, 0..1
  int min_inliers = 100;     ///< number of final matches that a keyframe must give, >= 4
  /// In mode fixed: if the shorter side of the reference is below this, px, features of the
  /// reference and of the frames are also searched in enlarged copies (OrbOptions::first_level).
  /// The copies are up to four times as large, and at most 2500 px long. Never with TEBLID; 0:
  /// never. OpenCV makes the copies, with its own threads and a little memory for each frame.
  int enlarge_below = 0;
};

/// Options of the extractor, of the stages and of the reference. The defaults are the paper's
/// method, for neighbouring frames. A fixed reference is seen from any viewpoint, and needs
/// MatcherOptions::robust() with 13 GrowthOptions::views, and 5000 features of uniform
/// KeypointDistribution.
struct SequenceOptions {
  OrbOptions orb;
  MatcherOptions matcher;
  ReferenceOptions reference;
};

/// Returns `options` with the changes that SequenceMatcher makes: `orb.images` is share with
/// alignment and none without; growth is off in mode previous, since a video does not need it. Use
/// these if you extract features elsewhere. (An enlarged fixed reference is extracted again.)
SequenceOptions withImages(SequenceOptions options);

/// Why a frame had no reference. The values equal the REASON_ constants in the messages.
enum class NoReference : std::uint8_t {
  none = 0,         ///< there was a reference
  first_frame = 1,  ///< there was no previous frame
  gap = 2,          ///< the previous frame is older than max_age
  /// The previous frame is newer. A single frame of this kind is skipped, and the next frame is
  /// matched as if it were missing. Two in a row are a looped recording.
  stamp_went_back = 3,
  size_changed = 4,      ///< the previous frame has another width or height
  encoding_changed = 5,  ///< the previous frame has another encoding
  not_set = 6,           ///< fixed mode without a reference
  reset = 7,             ///< reset() was called since the previous frame
  mode_changed = 8,      ///< the reference mode was changed since the previous frame
  lens_changed = 9,  ///< the previous frame has another lens, or only one of the frames has a lens
};

/// The enumerator's own name, e.g. "stamp_went_back".
const char* toString(NoReference reason);

/// An image of the sequence and its features.
struct Frame {
  std::int64_t stamp = 0;  ///< time of the image, ns since any epoch
  std::string encoding;    ///< the caller's name of the camera's pixel format; may be empty
  cv::Mat image;           ///< CV_8UC1; empty if the caller has only the features
  /// CV_8UC1, the size of `image`: keypoints are found where it is not zero; everywhere if empty.
  cv::Mat mask;
  /// If set, the keypoints are moved to their positions without distortion, and there is no
  /// sub-pixel alignment, since the image is still distorted. If null, the keypoints stay.
  LensConstPtr lens;
  /// K of the image without distortion, px, for the two-view geometry; empty: not known.
  std::optional<Eigen::Matrix3d> camera;
  /// Maps points of `image` to the pixels of `camera`; null if they need no mapping.
  LensConstPtr camera_lens;
  Features features;
  /// A track number, >= 1, for each keypoint: a final match continues the track of its reference
  /// keypoint; every other keypoint begins a new track. Set by SequenceMatcher::match; empty
  /// before.
  std::vector<std::uint64_t> tracks;
  /// Options that `features` were found with. If the matcher needs other options, it extracts the
  /// features again into a new frame of the same image, and this frame does not change. Without an
  /// image, the features are used as they are.
  std::optional<OrbOptions> orb;
  double extraction_milliseconds = 0.0;
  /// Owner of the pixels of `image` (for example a message) if `image` does not own them.
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
  FrameConstPtr reference;                       ///< null if there was none; see `no_reference`
  NoReference no_reference = NoReference::none;  ///< reason if `reference` is null
  /// Whether the image only repeats the previous image, with the same pixels or compressed anew.
  /// Drivers and videos with a doubled frame rate do this. A repeated image is not a new frame: all
  /// other fields, `frame` included, keep the result of the previous frame. If an image stays the
  /// same for longer than images have taken to change (or 0.1 s if none has changed), the camera
  /// stands still, and equal images are new frames.
  bool repeated = false;
  bool reference_changed = false;  ///< the previous frame had another reference
  MatchResult match;               ///< if there is no reference: empty, with status no_reference
  /// Homography from the first frame of an unbroken sequence to this frame; empty at the start, in
  /// fixed mode and without a homography. The covariance is propagated to first order: noise adds
  /// up in squares, smooth errors linearly. (The keypoint errors of a frame enter two of the
  /// multiplied homographies with opposite signs, so the covariance is rather too large.) It is NaN
  /// if a covariance in the chain is NaN. The deviation from a plane is the largest in the chain.
  std::optional<UncertainHomography> accumulated;
  std::int64_t first_stamp = 0;  ///< stamp of the first frame of `accumulated`, ns
  /// Number of frames so far whose search near the prediction failed (Search::fell_back); see
  /// KnnOptions::search_radius.
  std::uint64_t fall_backs = 0;
  /// Time of the extraction and of all stages, including matches that were not used.
  double total_milliseconds = 0.0;
};

/// Whether a match needs only the features of its two frames. A search radius or two-view geometry
/// needs results of the previous frame; growth may need views.
bool canMatchAhead(const MatcherOptions& options);

/// A match that was computed in advance, for example in another thread, to save time later.
struct MatchAhead {
  FrameConstPtr reference;
  MatchResult result;
};

/// Matches the frames of a camera one after the other. Chooses the reference of each frame, and
/// multiplies the homographies. A reference that cannot belong to the same sequence as the next
/// frame is dropped; NoReference lists the cases.
///
/// With growth (GrowthOptions) and in fixed mode, the views of the reference are simulated before
/// its first match. In keyframe and fixed mode, a frame for which PROSAC finds no homography takes
/// longer, because growth runs; the number of seeds bounds the work.
///
/// With a search radius (KnnOptions), matches are searched near the positions that the motion
/// between the last two frames predicts. If that gives no homography, or less than half of the
/// inliers of the previous frame, the frame is matched again over the whole image, and the better
/// result counts.
///
/// An instance belongs to one thread at a time. In the steady state it allocates no memory, unless
/// frames are enlarged (ReferenceOptions::enlarge_below).
class SequenceMatcher {
 public:
  /// Throws std::invalid_argument naming the option and its range.
  explicit SequenceMatcher(const SequenceOptions& options = {});
  ~SequenceMatcher();
  SequenceMatcher(SequenceMatcher&&) noexcept;
  SequenceMatcher& operator=(SequenceMatcher&&) noexcept;

  /// The given options with the changes of withImages.
  const SequenceOptions& options() const;
  /// Applies from the next frame on. A change of the mode drops the reference, except a fixed one.
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
  /// Matches a frame, which is kept without a copy: do not change it until its use_count() is 1
  /// again. If `ahead` is given, canMatchAhead is true for the options, and its reference is the
  /// one that this frame needs, its result is used instead of a new match.
  const SequenceMatch& match(const FramePtr& frame, MatchAhead* ahead = nullptr);

  /// An empty frame to fill for match() or setFixedReference(), with the buffers of an unused
  /// frame.
  FramePtr newFrame();

  /// Sets the reference of the fixed mode, or removes it (null). If `frame` has no features yet,
  /// they are extracted at once in fixed mode, and in other modes when a frame first needs them.
  void setFixedReference(const FramePtr& frame);
  FrameConstPtr fixedReference() const;
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
