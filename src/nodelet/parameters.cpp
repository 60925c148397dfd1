#include "nodelet/parameters.h"

#include <boost/any.hpp>
#include <cmath>
#include <set>
#include <sstream>
#include <stdexcept>

namespace ktgp_orb {
namespace {

// Private parameters that are not dynamic: read by image_transport and at start.
const char* const kStaticParameters[] = {"image_transport", "queue_size"};

ReferenceMode referenceModeFrom(const std::string& name) {
  if (name == "previous") return ReferenceMode::previous;
  if (name == "keyframe") return ReferenceMode::keyframe;
  if (name == "fixed") return ReferenceMode::fixed;
  throw std::invalid_argument("reference_mode is '" + name +
                              "'; expected previous, keyframe or fixed");
}

ExtractorKind extractorFrom(const std::string& name) {
  if (name == "fast") return ExtractorKind::fast;
  if (name == "opencv") return ExtractorKind::opencv;
  throw std::invalid_argument("extractor is '" + name + "'; expected fast or opencv");
}

KeypointDistribution distributionFrom(const std::string& name) {
  if (name == "ranked") return KeypointDistribution::ranked;
  if (name == "uniform") return KeypointDistribution::uniform;
  throw std::invalid_argument("distribution is '" + name + "'; expected ranked or uniform");
}

[[noreturn]] void refuse(const std::string& parameter, const std::string& value,
                         const std::string& expected) {
  throw std::invalid_argument("parameter " + parameter + " is " + value + "; expected " + expected);
}

/// `low` and `high` hold the type the parameter was declared with.
void requireInRange(const std::string& parameter, XmlRpc::XmlRpcValue value, const boost::any& low,
                    const boost::any& high) {
  std::ostringstream given;
  value.write(given);
  const auto check = [&](double number, double lowest, double highest) {
    if (number >= lowest && number <= highest) return;
    std::ostringstream range;
    range << "a value in [" << lowest << ", " << highest << "]";
    refuse(parameter, given.str(), range.str());
  };
  const bool is_int = value.getType() == XmlRpc::XmlRpcValue::TypeInt;
  if (low.type() == typeid(double)) {
    if (!is_int && value.getType() != XmlRpc::XmlRpcValue::TypeDouble) {
      refuse(parameter, given.str(), "a number");
    }
    const double number = is_int ? static_cast<int>(value) : static_cast<double>(value);
    check(number, boost::any_cast<double>(low), boost::any_cast<double>(high));
  } else if (low.type() == typeid(int)) {
    if (!is_int) refuse(parameter, given.str(), "a whole number");
    check(static_cast<int>(value), boost::any_cast<int>(low), boost::any_cast<int>(high));
  } else if (low.type() == typeid(bool)) {
    if (value.getType() != XmlRpc::XmlRpcValue::TypeBoolean) {
      refuse(parameter, given.str(), "true or false");
    }
  } else if (value.getType() != XmlRpc::XmlRpcValue::TypeString) {
    refuse(parameter, given.str(), "a string");
  }
}

}  // namespace

Configuration configurationFrom(const KtgpConfig& config, std::uint32_t number) {
  Configuration c;
  c.number = number;
  c.orb.features = config.features;
  c.orb.scale_factor = config.scale_factor;
  c.orb.levels = config.levels;
  c.orb.fast_threshold = config.fast_threshold;
  c.orb.extractor = extractorFrom(config.extractor);
  c.orb.distribution = distributionFrom(config.distribution);
  c.orb.threads = config.threads;
  c.matcher.knn.threads = config.threads;
  c.matcher.ratio_threshold = config.T_w;
  c.matcher.gms.threshold = config.T_G;
  c.matcher.gms.rotation = config.gms_rotation;
  c.matcher.gms.scale = config.gms_scale;
  c.matcher.prosac.threshold = config.prosac_threshold;
  c.matcher.prosac.max_iterations = config.prosac_iterations;
  c.matcher.prosac.confidence = config.prosac_confidence;
  c.matcher.prosac.seed = static_cast<std::uint64_t>(config.prosac_seed);
  c.reference.mode = referenceModeFrom(config.reference_mode);
  c.reference.max_age = config.max_reference_age;
  c.reference.min_overlap = config.keyframe_min_overlap;
  c.reference.min_inliers = config.keyframe_min_inliers;
  c.overlay = config.overlay;
  c.threads = config.threads;
  const KtgpMatcher checked_matcher(c.matcher);
  const OrbExtractor checked_extractor(c.orb);
  return c;
}

void requireParametersInRange(const ros::NodeHandle& node) {
  for (const auto& description : KtgpConfig::__getParamDescriptions__()) {
    XmlRpc::XmlRpcValue value;
    if (!node.getParam(description->name, value)) continue;
    boost::any low;
    boost::any high;
    description->getValue(KtgpConfig::__getMin__(), low);
    description->getValue(KtgpConfig::__getMax__(), high);
    requireInRange(node.resolveName(description->name), value, low, high);
  }
  std::string mode;
  if (node.getParam("reference_mode", mode)) referenceModeFrom(mode);
}

std::vector<std::string> unknownParameters(const ros::NodeHandle& node) {
  std::set<std::string> known(std::begin(kStaticParameters), std::end(kStaticParameters));
  for (const auto& description : KtgpConfig::__getParamDescriptions__()) {
    known.insert(description->name);
  }
  const std::string prefix = node.getNamespace() + "/";
  std::vector<std::string> all;
  std::vector<std::string> unknown;
  node.getParamNames(all);
  for (const std::string& name : all) {
    if (name.compare(0, prefix.size(), prefix) != 0) continue;
    const std::string own = name.substr(prefix.size());
    // Plugins keep their own parameters below a topic, such as matches_image/compressed.
    if (own.find('/') == std::string::npos && known.count(own) == 0) unknown.push_back(name);
  }
  return unknown;
}

}  // namespace ktgp_orb
