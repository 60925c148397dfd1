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

/// What a frame is matched to.
enum class ReferenceMode : std::uint8_t {
  previous,  ///< the frame before, as in the paper
  keyframe,  ///< one frame for as long as it overlaps and gives enough matches: less drift
  fixed,     ///< one frame set by hand: tracking of a planar target
};

struct ReferenceOptions {
  ReferenceMode mode = ReferenceMode::previous;
  double max_age = 1.0;      ///< s from the frame before to this one, > 0; not in fixed mode
  double min_overlap = 0.5;  ///< keyframe: share of the target image that it covers, 0..1
  int min_inliers = 100;     ///< keyframe: final matches that it gives, >= 4
};

/// Options of the extractor, of the stages, and of what they are applied to.
struct SequenceOptions {
  OrbOptions orb;
  MatcherOptions matcher;
  ReferenceOptions reference;
};

/// `options` with `orb.images` as the sequence needs it: shared where the alignment is on, else
/// none, and without growth in mode previous: a video needs none. SequenceMatcher applies it;
/// features found elsewhere should be found with the same.
SequenceOptions withImages(SequenceOptions options);

/// Why a frame had no reference. The numbers are those of the REASON_ constants in the messages.
enum class NoReference : std::uint8_t {
  none = 0,              ///< it had one
  first_frame = 1,       ///< nothing came before
  gap = 2,               ///< the frame before is older than max_age
  stamp_went_back = 3,   ///< the frame before is newer: a looped recording
  size_changed = 4,      ///< the frame before has another width or height
  encoding_changed = 5,  ///< the frame before has another encoding
  not_set = 6,           ///< fixed mode, and no reference was set
  reset = 7,             ///< reset() was called since the frame before
  mode_changed = 8,      ///< the reference mode was changed since the frame before
  lens_changed = 9,      ///< the frame before was seen through another lens, or raw
};

/// The enumerator's own name, e.g. "stamp_went_back".
const char* toString(NoReference reason);

/// An image of the sequence with what was found in it.
struct Frame {
  std::int64_t stamp = 0;  ///< when it was taken, ns since any epoch
  std::string encoding;    ///< the caller's word for the camera's pixel format; may be empty
  cv::Mat image;           ///< CV_8UC1; empty where the caller has the features alone
  /// CV_8UC1, as large as `image`: keypoints are sought where it is not zero. Empty: everywhere.
  cv::Mat mask;
  /// Where set, the keypoints found in `image` are moved to where they are without distortion;
  /// there is no sub-pixel alignment then, since the image is still distorted. Null: they stay.
  LensConstPtr lens;
  Features features;
  /// What `features` were found with. Where it is not what the matcher's extractor has, they are
  /// found in `image`; without an image the features are taken as they are. A frame that has
  /// features stays as it is: those of other options are found in a new frame of the same image.
  std::optional<OrbOptions> orb;
  double extraction_milliseconds = 0.0;
  /// Keeps the pixels of `image` alive where it does not own them (a message, for example).
  std::shared_ptr<const void> source;
};

using FramePtr = std::shared_ptr<Frame>;
using FrameConstPtr = std::shared_ptr<const Frame>;

/// Finds the features of `frame.image` by its mask and lens, and notes the options and the time it
/// took.
void extractFeatures(OrbExtractor& extractor, Frame& frame);

/// Homography from the first frame of an unbroken sequence to the newest one.
struct AccumulatedHomography {
  std::int64_t first_stamp = 0;                              ///< of that first frame, ns
  Eigen::Matrix3d homography = Eigen::Matrix3d::Identity();  ///< H(2,2) = 1 unless near zero
  /// Of H's first eight entries, row by row, with H(2,2) = 1: the covariances of the multiplied
  /// homographies propagated to first order, as if their errors were independent. (A frame's
  /// keypoint errors enter two of them with opposite signs, so this is rather too large.) NaN where
  /// the covariance of one of them is.
  Covariance8 covariance = Covariance8::Zero();
};

/// All that came of one frame.
struct SequenceMatch {
  /// The target: the frame handed in, or a new one of its image (see Frame::orb).
  FrameConstPtr frame;
  FrameConstPtr reference;                       ///< null: none, and `no_reference` says why
  NoReference no_reference = NoReference::none;  ///< none: there was a reference
  bool reference_changed = false;                ///< it is not the reference of the frame before
  MatchResult match;                             ///< status no_reference, all empty without one
  std::optional<AccumulatedHomography> accumulated;  ///< nothing at the start of a chain, in fixed
                                                     ///< mode and without a homography
  /// Frames so far whose search near the prediction failed (Search::fell_back); see
  /// KnnOptions::search_radius.
  std::uint64_t fall_backs = 0;
  /// Extraction and all stages, those of matches that were not taken included.
  double total_milliseconds = 0.0;
};

/// A match made ahead of its turn, in another thread for example, to save the time when the turn
/// comes.
struct MatchAhead {
  FrameConstPtr reference;
  MatchResult result;
};

/// Matches the frames of a camera one after the other: decides what each is matched to, and
/// multiplies the homographies. It forgets the reference that cannot belong to the same sequence
/// as the next frame; NoReference says when that is.
///
/// With growth (GrowthOptions) and in fixed mode, the views of the reference are simulated when it
/// is first matched to. In keyframe and fixed mode a frame whose matches lead PROSAC nowhere takes
/// longer, by a number of seeds and not a time.
///
/// With a search radius (KnnOptions) matches are looked for where the motion between the last two
/// frames, carried on, puts them. A frame that so finds no homography, or less than half of the
/// inliers of the frame before, is matched once more over the whole image, and the better of the
/// two is the answer.
///
/// An instance belongs to one thread at a time. In the steady state nothing is allocated.
class SequenceMatcher {
 public:
  /// Throws std::invalid_argument naming the option and its range.
  explicit SequenceMatcher(const SequenceOptions& options = {});
  ~SequenceMatcher();
  SequenceMatcher(SequenceMatcher&&) noexcept;
  SequenceMatcher& operator=(SequenceMatcher&&) noexcept;

  /// As given, but for the images (see withImages).
  const SequenceOptions& options() const;
  /// From the next frame on. Another mode forgets the reference, but not a fixed one. Throws as the
  /// constructor does; nothing is changed then.
  void setOptions(const SequenceOptions& options);

  /// Matches the next image, taken at `seconds` since any epoch. `image`: 8-bit grey; it is copied.
  /// `encoding`: the camera's pixel format; a change of it starts a new sequence. The answer is
  /// valid until the next call. Throws std::invalid_argument for an image of another type and a
  /// time that is not finite or more than 292 years from zero; the frame then never was.
  const SequenceMatch& match(const cv::Mat& image, double seconds,
                             const std::string& encoding = {});
  /// The same for features found elsewhere. Throws as requireValid does.
  const SequenceMatch& match(const Features& features, double seconds);
  /// The same for a frame, which is kept and not copied: leave it alone until its use_count() is 1
  /// again. `ahead`, where not null, is used up instead of matching to the reference it names; not
  /// with a search radius, where the frame before must be known first.
  const SequenceMatch& match(const FramePtr& frame, MatchAhead* ahead = nullptr);

  /// An empty frame to fill for match() or setFixedReference(). Frames that nobody holds any more
  /// come back here, with their buffers.
  FramePtr newFrame();

  /// The reference of the fixed mode; null: none. In fixed mode its
  /// features are found at once where it has none, else when they are needed.
  void setFixedReference(const FramePtr& frame);
  FrameConstPtr fixedReference() const;
  /// The next frame becomes the fixed reference; it is the first that is matched to it.
  void fixNextFrame();

  /// The next frame is the first of a sequence; a fixed reference stays.
  void restart();
  /// Forgets every reference, the fixed one and a call of fixNextFrame() too.
  void reset();

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace ktgp_orb
