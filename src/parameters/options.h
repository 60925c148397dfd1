#pragma once

#include "ktgp_orb/ktgp_matcher.h"
#include "ktgp_orb/orb_extractor.h"
#include "ktgp_orb/overlay.h"
#include "ktgp_orb/sequence_matcher.h"
#include "parameters/parameters.h"

namespace ktgp_orb {

/// Everything that determines the result for a pair of images.
struct PipelineOptions {
  OrbOptions orb;
  MatcherOptions matcher;
  Parameters parameters{};  ///< the source of the other two; T_w is never 0
};

/// The parameters in the core's types. Throws std::invalid_argument with the parameter's name for
/// values that the core refuses.
PipelineOptions pipelineOptions(const Parameters& parameters);

/// The same for a sequence, with the options of the reference. A fixed reference is seen from
/// anywhere; the paper's method is for neighbouring frames. So reference_mode fixed uses what pairs
/// with strongly different views need in place of the defaults, unless a preset decides it.
SequenceOptions sequenceOptions(const Parameters& parameters);

/// The choices of sequenceOptions() for a fixed reference, as a message for the user; else empty.
std::string noteOnFixed(const Parameters& parameters);

/// Advice where images with this longer side, px, are not recognised, as a message for the
/// user; empty for those that are small enough.
std::string noteOnSize(int longer_side);

/// The overlay_style; the reference mode decides "auto": views of a fixed reference move too far
/// for strokes. Throws std::invalid_argument for an unknown style.
OverlayStyle overlayStyleFrom(const Parameters& parameters);

/// Throws std::invalid_argument for an unknown mode.
ReferenceMode referenceModeFrom(const std::string& name);

}  // namespace ktgp_orb
