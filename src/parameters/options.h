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
  /// The parameters from which `orb` and `matcher` were made; T_w is never 0.
  Parameters parameters{};
};

/// Converts the parameters to the core's types. Throws std::invalid_argument with the parameter's
/// name for values that the core refuses.
PipelineOptions pipelineOptions(const Parameters& parameters);

/// Like pipelineOptions(), but for a sequence; includes the options of the reference. The paper's
/// method is for neighbouring frames, but a fixed reference may be seen from anywhere. So for a
/// fixed reference, options for strongly different views replace defaults, unless a preset was
/// chosen.
SequenceOptions sequenceOptions(const Parameters& parameters);

/// Tells users which options sequenceOptions() chose for a fixed reference; empty if it chose none.
std::string noteOnFixed(const Parameters& parameters);

/// Advice for users whose images are not recognised. `longer_side`: longer side of the images, px.
/// Empty if the images are small enough.
std::string noteOnSize(int longer_side);

/// The style of the overlay. For "auto" it depends on the reference mode, because points move too
/// far for strokes if the reference is fixed. Throws std::invalid_argument for an unknown style.
OverlayStyle overlayStyleFrom(const Parameters& parameters);

/// Throws std::invalid_argument for an unknown mode.
ReferenceMode referenceModeFrom(const std::string& name);

}  // namespace ktgp_orb
