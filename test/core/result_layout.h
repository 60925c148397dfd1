#pragma once

#include <cstddef>

#include "ktgp_orb/alignment.h"
#include "ktgp_orb/evaluation.h"
#include "ktgp_orb/frame_path.h"
#include "ktgp_orb/ground_motion.h"
#include "ktgp_orb/growth.h"
#include "ktgp_orb/ktgp_matcher.h"
#include "ktgp_orb/lens.h"
#include "ktgp_orb/mosaic.h"
#include "ktgp_orb/overlay.h"
#include "ktgp_orb/planar_pose.h"
#include "ktgp_orb/sequence_matcher.h"
#include "ktgp_orb/stabilizer.h"
#include "ktgp_orb/target_finder.h"

namespace ktgp_orb::test {

/// A size or the offset of a member, in bytes.
struct LayoutEntry {
  const char* name;
  std::size_t bytes;
};

#define KTGP_ORB_TYPE(type)              \
  {#type, sizeof(type)}, {               \
    "alignment of " #type, alignof(type) \
  }
// The last member also checks those before it, in case one of them is a matrix.
#define KTGP_ORB_MEMBER(type, member) \
  { #type "::" #member, offsetof(type, member) }

/// Every public type, as compiled in the including file.
constexpr LayoutEntry kLayout[] = {
    KTGP_ORB_TYPE(AccumulatedHomography),
    KTGP_ORB_MEMBER(AccumulatedHomography, covariance),
    KTGP_ORB_TYPE(AlignedPoint),
    KTGP_ORB_MEMBER(AlignedPoint, correlation),
    KTGP_ORB_TYPE(Alignment),
    KTGP_ORB_TYPE(AlignmentOptions),
    KTGP_ORB_TYPE(AlignmentResult),
    KTGP_ORB_MEMBER(AlignmentResult, answer),
    KTGP_ORB_MEMBER(AlignmentResult, rmse_after),
    KTGP_ORB_TYPE(Correspondence),
    KTGP_ORB_TYPE(DetectedTarget),
    KTGP_ORB_MEMBER(DetectedTarget, homography),
    KTGP_ORB_MEMBER(DetectedTarget, pairs),
    KTGP_ORB_TYPE(evaluation::ErrorSummary),
    KTGP_ORB_TYPE(evaluation::Repeatability),
    KTGP_ORB_TYPE(Features),
    KTGP_ORB_TYPE(Frame),
    KTGP_ORB_TYPE(FramePath),
    KTGP_ORB_TYPE(FramePath::Step),
    KTGP_ORB_MEMBER(FramePath::Step, to_newest),
    KTGP_ORB_TYPE(FrameView),
    KTGP_ORB_TYPE(GmsFilter),
    KTGP_ORB_TYPE(GmsOptions),
    KTGP_ORB_TYPE(GmsResult),
    KTGP_ORB_TYPE(DownReading),
    KTGP_ORB_TYPE(GroundEstimate),
    KTGP_ORB_MEMBER(GroundEstimate, twist_covariance),
    KTGP_ORB_TYPE(GroundFrame),
    KTGP_ORB_MEMBER(GroundFrame, homography),
    KTGP_ORB_MEMBER(GroundFrame, plane_deviation),
    KTGP_ORB_TYPE(GroundMotion),
    KTGP_ORB_TYPE(GroundMotionOptions),
    KTGP_ORB_TYPE(HeightReading),
    KTGP_ORB_TYPE(TurnReading),
    KTGP_ORB_TYPE(GrowthOptions),
    KTGP_ORB_TYPE(GrowthResult),
    KTGP_ORB_TYPE(GrowthStart),
    KTGP_ORB_MEMBER(GrowthResult, answer),
    KTGP_ORB_MEMBER(GrowthResult, judged),
    KTGP_ORB_TYPE(GuidedMatcher),
    KTGP_ORB_TYPE(GuidedOptions),
    KTGP_ORB_TYPE(HomographyGrowth),
    KTGP_ORB_TYPE(KnnMatcher),
    KTGP_ORB_TYPE(KnnOptions),
    KTGP_ORB_TYPE(KtgpMatcher),
    KTGP_ORB_TYPE(Lens),
    KTGP_ORB_TYPE(LensCalibration),
    KTGP_ORB_TYPE(MatchAhead),
    KTGP_ORB_MEMBER(MatchAhead, result),
    KTGP_ORB_TYPE(MatcherOptions),
    KTGP_ORB_TYPE(MatchHints),
    KTGP_ORB_MEMBER(MatchHints, views),
    KTGP_ORB_TYPE(MatchResult),
    KTGP_ORB_MEMBER(MatchResult, stages),
    KTGP_ORB_MEMBER(MatchResult, answer),
    KTGP_ORB_MEMBER(MatchResult, rmse),
    KTGP_ORB_TYPE(Mosaic),
    KTGP_ORB_TYPE(MosaicOptions),
    KTGP_ORB_TYPE(OrbExtractor),
    KTGP_ORB_TYPE(OrbOptions),
    KTGP_ORB_TYPE(PlanarPose),
    KTGP_ORB_MEMBER(PlanarPose, covariance),
    KTGP_ORB_TYPE(PointPairs),
    KTGP_ORB_MEMBER(PointPairs, noise),
    KTGP_ORB_TYPE(ProsacDiagnostics),
    KTGP_ORB_TYPE(ProsacHomography),
    KTGP_ORB_TYPE(ProsacOptions),
    KTGP_ORB_TYPE(ProsacResult),
    KTGP_ORB_MEMBER(ProsacResult, answer),
    KTGP_ORB_TYPE(ReferenceOptions),
    KTGP_ORB_TYPE(ReferenceView),
    KTGP_ORB_MEMBER(ReferenceView, to_view),
    KTGP_ORB_TYPE(SequenceMatch),
    KTGP_ORB_MEMBER(SequenceMatch, match),
    KTGP_ORB_MEMBER(SequenceMatch, accumulated),
    KTGP_ORB_MEMBER(SequenceMatch, total_milliseconds),
    KTGP_ORB_TYPE(SequenceMatcher),
    KTGP_ORB_TYPE(SequenceOptions),
    KTGP_ORB_TYPE(Stabilizer),
    KTGP_ORB_TYPE(StabilizerOptions),
    KTGP_ORB_TYPE(Target),
    KTGP_ORB_TYPE(TargetFinder),
    KTGP_ORB_TYPE(TargetFinderOptions),
    KTGP_ORB_TYPE(TargetFrame),
    KTGP_ORB_TYPE(TargetSearch),
    KTGP_ORB_TYPE(StageResult),
    KTGP_ORB_TYPE(SteadyFrame),
    KTGP_ORB_MEMBER(SteadyFrame, starts_anew),
    KTGP_ORB_TYPE(UncertainHomography),
    KTGP_ORB_MEMBER(UncertainHomography, plane_deviation),
};

#undef KTGP_ORB_TYPE
#undef KTGP_ORB_MEMBER

/// kLayout in a program built for the widest vectors.
const LayoutEntry* layoutForWideVectors();

}  // namespace ktgp_orb::test
