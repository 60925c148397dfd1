#include "parameters/options.h"

#include <stdexcept>
#include <tuple>
#include <variant>

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

/// Sets the options of the matching library from the parameters.
SequenceOptions optionsFrom(const Parameters& p) {
  SequenceOptions options;
  OrbOptions& orb = options.orb;
  MatcherOptions& matcher = options.matcher;
  ReferenceOptions& reference = options.reference;
#define KTGP_ROW(name, value, ...) setAll(p.name, std::tie(__VA_ARGS__));
#include "parameters/each_row.def"
#include "parameters/table.def"
#include "parameters/table_end.def"
  matcher.shared_errors = SharedErrors::ofRealCameras();
  return options;
}

/// Returns true if we should choose options that suit a fixed reference: if reference_mode is
/// fixed, and the user has set no preset or only the preset video. T_w shows whether another preset
/// was set: ktgp and teblid set T_w to the threshold of their descriptor, and the presets for
/// strongly different views set T_w to 1, mutual to true and gms to false.
bool choosesForFixed(const Parameters& p) {
  const bool is_of_a_preset = p.T_w == ratioThreshold(DescriptorKind::orb) ||
                              p.T_w == ratioThreshold(DescriptorKind::teblid) ||
                              (p.T_w == 1.0 && p.mutual && !p.gms);
  return p.reference_mode == "fixed" && !is_of_a_preset;
}

/// Returns the parameters that suit a fixed reference, which may be seen from a very different
/// viewpoint.
Parameters wantedForFixed() {
  Parameters wanted;
  wanted.features = 5000;
  wanted.distribution = "uniform";
  wanted.T_w = 1.0;
  wanted.mutual = wanted.growth = wanted.guided = true;
  wanted.gms = false;
  wanted.views = 13;
  wanted.search_radius =
      48.0;  // px, as in preset video; if points move farther, the whole image is searched
  return wanted;
}

/// Replaces every parameter that has its default value by the value of wantedForFixed(), even if
/// the user set the default value by hand.
Parameters chosenForFixed(const Parameters& given) {
  const Parameters usual;
  const Parameters wanted = wantedForFixed();
  Parameters chosen = given;
  for (const ParameterRow& row : parameterRows()) {
    std::visit(
        [&](auto field) {
          if (given.*field == usual.*field) chosen.*field = wanted.*field;
        },
        row.field);
  }
  return chosen;
}

}  // namespace

std::string noteOnFixed(const Parameters& parameters) {
  if (!choosesForFixed(parameters)) return {};
  const Parameters chosen = chosenForFixed(parameters);
  std::string values;
  for (const ParameterRow& row : parameterRows()) {
    const std::string value = valueText(row, chosen);
    if (value == valueText(row, parameters)) continue;
    values += (values.empty() ? "" : ", ") + row.name + ' ' + value;
  }
  const std::string uses = values.empty() ? "" : "uses " + values + ", which were not set; ";
  return "reference_mode is fixed, so the reference may be seen from anywhere: " + uses +
         "enlarges a reference whose shorter side is below 150 px, and the "
         "frames with it (not with teblid)";
}

std::string noteOnSize(int longer_side) {
  // The user gets advice if the longer side is above this, px. At this length, the smallest of the
  // pyramid's 8 levels is still 700 px long.
  constexpr int kLargest = 2500;
  if (longer_side <= kLargest) return {};
  return "the images are " + std::to_string(longer_side) +
         " px long; made 1000 to 2500 px long first, they may be recognised";
}

PipelineOptions pipelineOptions(const Parameters& given) {
  requireValid(given);
  Parameters parameters = choosesForFixed(given) ? chosenForFixed(given) : given;
  if (parameters.T_w == 0.0) {
    parameters.T_w = ratioThreshold(descriptorFrom(parameters.descriptor));
  }
  const SequenceOptions options = optionsFrom(parameters);
  return {options.orb, options.matcher, parameters};
}

SequenceOptions sequenceOptions(const Parameters& given) {
  SequenceOptions options = optionsFrom(pipelineOptions(given).parameters);
  if (choosesForFixed(given)) options.reference.enlarge_below = 150;
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
