#include "parameters/options.h"

#include <stdexcept>
#include <tuple>

namespace ktgp_orb {
namespace {

DescriptorKind descriptorFrom(const std::string& name) {
  return name == "teblid" ? DescriptorKind::teblid : DescriptorKind::orb;
}

GeometryModel geometryFrom(const std::string& name) {
  if (name == "auto") return GeometryModel::automatic;
  return name == "epipolar" ? GeometryModel::epipolar : GeometryModel::homography;
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
  matcher.gms.grid_columns = matcher.gms.grid_rows = p.gms_grid;
  matcher.prosac.max_error = p.prosac_threshold;
  matcher.growth.enabled = p.growth;
  matcher.growth.views = p.views;
  matcher.guided.enabled = p.guided;
  matcher.alignment.enabled = p.alignment;
  matcher.geometry = geometryFrom(p.geometry);
  matcher.two_view = TwoViewOptions::realCameras();
  return matcher;
}

/// The methods that decide how far the views of a pair may differ.
auto methodsOf(const Parameters& p) {
  return std::tie(p.features, p.distribution, p.descriptor, p.T_w, p.mutual, p.gms, p.growth,
                  p.views, p.guided, p.alignment, p.geometry);
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

PipelineOptions pipelineOptions(const Parameters& given) {
  requireValid(given);
  Parameters parameters = given;
  if (given.T_w == 0.0) parameters.T_w = ratioThreshold(descriptorFrom(given.descriptor));
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
  return sequence;
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
