#pragma once

#include "ktgp_orb/ktgp_matcher.h"
#include "ktgp_orb/orb_extractor.h"
#include "ktgp_orb/overlay.h"
#include "ktgp_orb/sequence_matcher.h"
#include "parameters/parameters.h"

namespace ktgp_orb {

/// All options that determine the result for a pair of images.
struct PipelineOptions {
  OrbOptions orb;
  MatcherOptions matcher;
  /// The parameters from which `orb` and `matcher` were set. T_w is never 0 here, because 0 is
  /// replaced by the default of the descriptor.
  Parameters parameters{};
};

/// Converts the parameters to the options of the matching library. Throws std::invalid_argument,
/// with the name of the parameter, for a value that is not allowed.
PipelineOptions pipelineOptions(const Parameters& parameters);

/// Like pipelineOptions(), but for a sequence; includes the options of the reference. The defaults
/// are the paper's method, which is made for neighbouring frames, but a fixed reference may be seen
/// from anywhere. So if the reference is fixed and no preset was chosen, the defaults are replaced
/// by options for strongly different views.
SequenceOptions sequenceOptions(const Parameters& parameters);

/// Returns a text that tells users which options sequenceOptions() chose for a fixed reference;
/// empty if it chose none.
std::string noteOnFixed(const Parameters& parameters);

/// Returns advice for users whose images are too large to be recognised well. `longer_side`: longer
/// side of the images, px. Empty if the images are small enough.
std::string noteOnSize(int longer_side);

/// Returns the style of the overlay. If the parameter is "auto", the style is side_by_side for a
/// fixed reference, because points move too far to be shown as strokes, and flow otherwise. Throws
/// std::invalid_argument for an unknown style.
OverlayStyle overlayStyleFrom(const Parameters& parameters);

/// Converts the name of a reference mode. Throws std::invalid_argument for an unknown name.
ReferenceMode referenceModeFrom(const std::string& name);

}  // namespace ktgp_orb
