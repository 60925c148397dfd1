#include "parameters/options.h"

#include <sstream>
#include <stdexcept>
#include <tuple>

namespace ktgp_orb {
namespace {

DescriptorKind descriptorFrom(const std::string& name) {
  return name == "teblid" ? DescriptorKind::teblid : DescriptorKind::orb;
}

OrbOptions orbOptions(const Parameters& p) {
  OrbOptions orb;
  orb.max_features = p.features;
  orb.scale_factor = p.scale_factor;
  orb.levels = p.levels;
  orb.fast_threshold = p.fast_threshold;
  orb.descriptor = descriptorFrom(p.descriptor);
  orb.distribution =
      p.distribution == "uniform" ? KeypointDistribution::uniform : KeypointDistribution::ranked;
  orb.keypoints_per_cell = p.keypoints_per_cell;
  orb.threads = p.threads;
  return orb;
}

MatcherOptions matcherOptions(const Parameters& p) {
  MatcherOptions matcher;
  matcher.knn.threads = p.threads;
  matcher.knn.search_radius = p.search_radius;
  matcher.ratio_threshold = p.T_w;
  matcher.mutual = p.mutual;
  matcher.gms.enabled = p.gms;
  matcher.gms.threshold = p.T_G;
  matcher.gms.rotation = p.gms_rotation;
  matcher.gms.scale = p.gms_scale;
  matcher.gms.grid_columns = p.gms_columns;
  matcher.gms.grid_rows = p.gms_rows;
  matcher.prosac.max_error = p.prosac_threshold;
  matcher.prosac.max_iterations = p.prosac_iterations;
  matcher.prosac.confidence = p.prosac_confidence;
  matcher.prosac.seed = static_cast<std::uint64_t>(p.prosac_seed);
  matcher.growth.enabled = p.growth;
  matcher.growth.seeds = p.growth_seeds;
  matcher.growth.views = p.views;
  matcher.guided.enabled = p.guided;
  matcher.guided.radius = p.guided_radius;
  matcher.alignment.enabled = p.alignment;
  matcher.alignment.points = p.alignment_points;
  return matcher;
}

/// The methods that decide how far the views of a pair may differ.
auto methodsOf(const Parameters& p) {
  return std::tie(p.features, p.distribution, p.descriptor, p.T_w, p.mutual, p.gms, p.growth,
                  p.views, p.guided, p.alignment);
}

}  // namespace

bool choosesForFixed(const Parameters& parameters) {
  return parameters.reference_mode == "fixed" && methodsOf(parameters) == methodsOf(Parameters{});
}

std::string noteOnFixed(const Parameters& parameters) {
  if (!choosesForFixed(parameters)) return {};
  return "reference_mode is fixed, and nothing was set that decides how far views may differ: uses "
         "preset robust with views 13, features 5000 and distribution uniform";
}

PipelineOptions pipelineOptions(const Parameters& parameters) {
  requireValid(parameters);
  return {orbOptions(parameters), matcherOptions(parameters), parameters};
}

SequenceOptions sequenceOptions(const Parameters& given) {
  Parameters parameters = given;
  if (choosesForFixed(given)) {
    parameters.features = 5000;
    parameters.distribution = "uniform";
    parameters.T_w = 1.0;
    parameters.mutual = parameters.growth = parameters.guided = true;
    parameters.gms = false;
    parameters.views = 13;
  }
  const PipelineOptions pipeline = pipelineOptions(parameters);
  SequenceOptions sequence;
  sequence.orb = pipeline.orb;
  sequence.matcher = pipeline.matcher;
  sequence.reference.mode = referenceModeFrom(parameters.reference_mode);
  sequence.reference.max_age = parameters.max_reference_age;
  sequence.reference.min_overlap = parameters.keyframe_min_overlap;
  sequence.reference.min_inliers = parameters.keyframe_min_inliers;
  return sequence;
}

double followDescriptor(double threshold, const std::string& from, const std::string& to) {
  return threshold == ratioThreshold(descriptorFrom(from)) ? ratioThreshold(descriptorFrom(to))
                                                           : threshold;
}

std::string noteOnRatioThreshold(double threshold, const std::string& descriptor) {
  const DescriptorKind kind = descriptorFrom(descriptor);
  for (const DescriptorKind other : {DescriptorKind::orb, DescriptorKind::teblid}) {
    if (other == kind || threshold != ratioThreshold(other)) continue;
    std::ostringstream note;
    note << "T_w is " << threshold << ", the value for " << toString(other) << " descriptors; for "
         << toString(kind) << " " << ratioThreshold(kind) << " is better (doc/tuning.md)";
    return note.str();
  }
  return {};
}

OverlayStyle overlayStyleFrom(const Parameters& parameters) {
  const std::string& name = parameters.overlay_style;
  if (name == "auto") {
    return referenceModeFrom(parameters.reference_mode) == ReferenceMode::fixed
               ? OverlayStyle::side_by_side
               : OverlayStyle::flow;
  }
  for (const OverlayStyle style :
       {OverlayStyle::flow, OverlayStyle::side_by_side, OverlayStyle::difference}) {
    if (name == toString(style)) return style;
  }
  throw std::invalid_argument("overlay_style is '" + name +
                              "'; expected auto, flow, side_by_side or difference");
}

ReferenceMode referenceModeFrom(const std::string& name) {
  if (name == "previous") return ReferenceMode::previous;
  if (name == "keyframe") return ReferenceMode::keyframe;
  if (name == "fixed") return ReferenceMode::fixed;
  throw std::invalid_argument("reference_mode is '" + name +
                              "'; expected previous, keyframe or fixed");
}

}  // namespace ktgp_orb
