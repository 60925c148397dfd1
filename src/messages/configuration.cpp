#include "messages/configuration.h"

#include <stdexcept>
#include <string>

namespace ktgp_orb {
namespace {

ExtractorKind extractorFrom(const std::string& name) {
  if (name == "fast") return ExtractorKind::native;
  if (name == "opencv") return ExtractorKind::opencv;
  throw std::invalid_argument("extractor is '" + name + "'; expected fast or opencv");
}

KeypointDistribution distributionFrom(const std::string& name) {
  if (name == "ranked") return KeypointDistribution::ranked;
  if (name == "uniform") return KeypointDistribution::uniform;
  throw std::invalid_argument("distribution is '" + name + "'; expected ranked or uniform");
}

}  // namespace

ReferenceMode referenceModeFrom(const std::string& name) {
  if (name == "previous") return ReferenceMode::previous;
  if (name == "keyframe") return ReferenceMode::keyframe;
  if (name == "fixed") return ReferenceMode::fixed;
  throw std::invalid_argument("reference_mode is '" + name +
                              "'; expected previous, keyframe or fixed");
}

Configuration configurationFrom(const KtgpConfig& config, std::uint32_t number) {
  Configuration c;
  c.number = number;
  c.sequence.orb.max_features = config.features;
  c.sequence.orb.scale_factor = config.scale_factor;
  c.sequence.orb.levels = config.levels;
  c.sequence.orb.fast_threshold = config.fast_threshold;
  c.sequence.orb.extractor = extractorFrom(config.extractor);
  c.sequence.orb.distribution = distributionFrom(config.distribution);
  c.sequence.orb.threads = config.threads;
  c.sequence.matcher.knn.threads = config.threads;
  c.sequence.matcher.ratio_threshold = config.T_w;
  c.sequence.matcher.gms.threshold = config.T_G;
  c.sequence.matcher.gms.rotation = config.gms_rotation;
  c.sequence.matcher.gms.scale = config.gms_scale;
  c.sequence.matcher.prosac.max_error = config.prosac_threshold;
  c.sequence.matcher.prosac.max_iterations = config.prosac_iterations;
  c.sequence.matcher.prosac.confidence = config.prosac_confidence;
  c.sequence.matcher.prosac.seed = static_cast<std::uint64_t>(config.prosac_seed);
  c.sequence.reference.mode = referenceModeFrom(config.reference_mode);
  c.sequence.reference.max_age = config.max_reference_age;
  c.sequence.reference.min_overlap = config.keyframe_min_overlap;
  c.sequence.reference.min_inliers = config.keyframe_min_inliers;
  c.overlay = config.overlay;
  c.threads = config.threads;
  const SequenceMatcher checked(c.sequence);
  return c;
}

}  // namespace ktgp_orb
