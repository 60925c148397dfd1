#pragma once

#include "ktgp_orb/ktgp_matcher.h"
#include "ktgp_orb/orb_extractor.h"
#include "ktgp_orb/overlay.h"
#include "ktgp_orb/sequence_matcher.h"
#include "parameters/parameters.h"

namespace ktgp_orb {

/// Everything that decides the outcome for a pair of images.
struct PipelineOptions {
  OrbOptions orb;
  MatcherOptions matcher;
  Parameters parameters{};  ///< from which the other two were made
};

/// The parameters as the core takes them. Throws std::invalid_argument naming the parameter for
/// what the core refuses.
PipelineOptions pipelineOptions(const Parameters& parameters);

/// The same for a sequence, with what decides the reference.
SequenceOptions sequenceOptions(const Parameters& parameters);

/// What `threshold` (T_w) is where nobody sets it and the descriptor goes from one kind to another:
/// the new kind's own (see ratioThreshold) where it was the old kind's own, else as it is.
double followDescriptor(double threshold, const std::string& from, const std::string& to);

/// A line for the user where `threshold` (T_w) is the own one of another kind than `descriptor`;
/// else empty.
std::string noteOnRatioThreshold(double threshold, const std::string& descriptor);

/// The overlay_style, "auto" decided by the reference mode: another view of a fixed reference has
/// moved too far for strokes. Throws std::invalid_argument for a name that is no style.
OverlayStyle overlayStyleFrom(const Parameters& parameters);

/// Throws std::invalid_argument for a name that is no mode.
ReferenceMode referenceModeFrom(const std::string& name);

}  // namespace ktgp_orb
