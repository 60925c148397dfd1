#include "parameters/options.h"

#include <stdexcept>
#include <tuple>

namespace ktgp_orb {
namespace {

DescriptorKind descriptorFrom(const std::string& name) {
  return name == "teblid" ? DescriptorKind::teblid : DescriptorKind::orb;
}

template <typename Option, typename Value>
void set(Option& option, const Value& value) {
  option = value;
}
void set(DescriptorKind& kind, const std::string& name) {
  kind = descriptorFrom(name);
}
void set(GeometryModel& model, const std::string& name) {
  model = name == "auto"       ? GeometryModel::automatic
          : name == "epipolar" ? GeometryModel::epipolar
                               : GeometryModel::homography;
}
void set(KeypointDistribution& distribution, const std::string& name) {
  distribution = name == "uniform" ? KeypointDistribution::uniform : KeypointDistribution::ranked;
}
void set(ReferenceMode& mode, const std::string& name) {
  mode = referenceModeFrom(name);
}

template <typename Value, typename... Options>
void setAll(const Value& value, const std::tuple<Options&...>& options) {
  std::apply([&](Options&... option) { (set(option, value), ...); }, options);
}

/// The options that the table names.
SequenceOptions optionsFrom(const Parameters& p) {
  SequenceOptions options;
  auto& [orb, matcher, reference] = options;
#define KTGP_ROW(name, value, ...) setAll(p.name, std::tie(__VA_ARGS__));
#include "parameters/each_row.def"
#include "parameters/table.def"
#include "parameters/table_end.def"
  matcher.two_view = TwoViewOptions::realCameras();
  return options;
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
         "preset robust with views 13, features 5000, distribution uniform and, unless it is set, "
         "search_radius 48; enlarges a reference whose shorter side is below 150 px, "
         "and the frames with it";
}

PipelineOptions pipelineOptions(const Parameters& given) {
  requireValid(given);
  Parameters parameters = given;
  if (given.T_w == 0.0) parameters.T_w = ratioThreshold(descriptorFrom(given.descriptor));
  const SequenceOptions options = optionsFrom(parameters);
  return {options.orb, options.matcher, parameters};
}

SequenceOptions sequenceOptions(const Parameters& given) {
  if (!choosesForFixed(given)) return optionsFrom(pipelineOptions(given).parameters);
  Parameters parameters = given;
  parameters.features = 5000;
  parameters.distribution = "uniform";
  parameters.T_w = 1.0;
  parameters.mutual = parameters.growth = parameters.guided = true;
  parameters.gms = false;
  parameters.views = 13;
  // As preset video. What moves farther is searched in the whole image.
  if (parameters.search_radius == 0.0) parameters.search_radius = 48.0;
  SequenceOptions options = optionsFrom(pipelineOptions(parameters).parameters);
  options.reference.enlarge_below = 150;
  return options;
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
