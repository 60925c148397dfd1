// Compares the table of parameters with the core: ranges within the core's limits. The defaults:
// see presets_test.
#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <set>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "parameters/near_name.h"
#include "parameters/options.h"
#include "refusal.h"

namespace ktgp_orb {
namespace {

const double* valueOf(const ParameterRow& row, const Parameters& parameters) {
  const auto* field = std::get_if<double Parameters::*>(&row.field);
  return field == nullptr ? nullptr : &(parameters.*(*field));
}

TEST(Parameters, TheRatioThresholdIsThatOfTheDescriptorUnlessItIsSet) {
  Parameters parameters;
  EXPECT_EQ(pipelineOptions(parameters).orb.descriptor, DescriptorKind::orb);
  for (const auto& [descriptor, usual] : {std::pair("orb", 0.66), std::pair("teblid", 0.8)}) {
    parameters.descriptor = descriptor;
    EXPECT_EQ(toString(pipelineOptions(parameters).orb.descriptor), std::string(descriptor));
    parameters.T_w = 0.0;
    EXPECT_EQ(pipelineOptions(parameters).matcher.ratio_threshold, usual);
    EXPECT_EQ(pipelineOptions(parameters).parameters.T_w, usual);
    parameters.T_w = 0.7;
    EXPECT_EQ(pipelineOptions(parameters).matcher.ratio_threshold, 0.7);
  }
  parameters.descriptor = "sift";
  EXPECT_THROW(pipelineOptions(parameters), std::invalid_argument);
}

TEST(Parameters, EveryNodeletHasItsTableAndNothingIsTakenFromAnother) {
  for (const char* nodelet : {"matcher", "mosaic", "stabilizer", "targets", "ground_motion"}) {
    std::set<std::string> names;
    for (const ParameterInfo& info : parametersOf(nodelet)) {
      EXPECT_TRUE(names.insert(info.name).second) << info.name;
      EXPECT_EQ(&parameterOf(nodelet, info.name), &info);
    }
    EXPECT_THROW(parameterOf(nodelet, "lazziness"), std::invalid_argument);
  }
  EXPECT_EQ(parameterOf("targets", "search_ms").limits.text(), "[0, 1000]");
  EXPECT_THROW(parameterOf("mosaic", "strength"), std::invalid_argument);
  EXPECT_THROW(parametersOf("painter"), std::invalid_argument);
}

/// The paper's method is for neighbouring frames; a fixed reference is seen from anywhere.
TEST(Parameters, ChooseTheMethodForAFixedReference) {
  Parameters parameters;
  EXPECT_FALSE(sequenceOptions(parameters).matcher.growth.enabled);
  EXPECT_EQ(noteOnFixed(parameters), "");
  parameters.reference_mode = "fixed";
  const SequenceOptions chosen = sequenceOptions(parameters);
  EXPECT_TRUE(chosen.matcher.mutual && chosen.matcher.guided.enabled);
  EXPECT_TRUE(chosen.matcher.growth.enabled && !chosen.matcher.gms.enabled);
  EXPECT_EQ(chosen.matcher.ratio_threshold, 1.0);
  EXPECT_EQ(chosen.matcher.growth.views, 13);
  EXPECT_EQ(chosen.matcher.knn.search_radius, 48.0);
  EXPECT_EQ(chosen.orb.max_features, 5000);
  EXPECT_EQ(chosen.orb.distribution, KeypointDistribution::uniform);
  EXPECT_EQ(chosen.reference.enlarge_below, 150);
  for (const char* words : {"T_w 1", "gms false", "growth true", "views 13", "features 5000",
                            "distribution uniform", "search_radius 48", "below 150 px"}) {
    test::expectSays(noteOnFixed(parameters), words);
  }
}

TEST(Parameters, AdviseSmallerImages) {
  EXPECT_EQ(noteOnSize(2500), "");
  test::expectSays(noteOnSize(4032), "are 4032 px long; made 1000 to 2500 px long");
}

/// With fewer features or another descriptor the reference is still found from anywhere.
TEST(Parameters, ValuesSetForAFixedReferenceStay) {
  const auto chosenFor = [](const std::string& name, const std::string& value) {
    Parameters set;
    set.reference_mode = "fixed";
    setParameter(*findParameter(name), value, set);
    const SequenceOptions chosen = sequenceOptions(set);
    EXPECT_TRUE(chosen.matcher.growth.enabled && !chosen.matcher.gms.enabled) << name;
    EXPECT_EQ(chosen.reference.enlarge_below, 150) << name;
    test::expectSays(noteOnFixed(set), "gms false");
    EXPECT_EQ(noteOnFixed(set).find(name + " "), std::string::npos) << "it was not chosen";
    return chosen;
  };
  EXPECT_EQ(chosenFor("features", "3000").orb.max_features, 3000);
  EXPECT_EQ(chosenFor("features", "3000").matcher.growth.views, 13);
  EXPECT_EQ(chosenFor("T_w", "0.7").matcher.ratio_threshold, 0.7);
  EXPECT_EQ(chosenFor("descriptor", "teblid").orb.descriptor, DescriptorKind::teblid);
  EXPECT_EQ(chosenFor("descriptor", "teblid").matcher.ratio_threshold, 1.0);
  EXPECT_EQ(chosenFor("prosac_threshold", "2").matcher.prosac.max_error, 2.0);
  EXPECT_EQ(chosenFor("search_radius", "16").matcher.knn.search_radius, 16.0);
  EXPECT_EQ(chosenFor("views", "5").matcher.growth.views, 5);
  EXPECT_EQ(chosenFor("growth", "true").orb.max_features, 5000);
  EXPECT_EQ(chosenFor("guided", "true").matcher.growth.views, 13);
  EXPECT_FALSE(chosenFor("alignment", "false").matcher.alignment.enabled);
  EXPECT_EQ(chosenFor("geometry", "auto").matcher.geometry, GeometryModel::automatic);
}

TEST(Parameters, ChooseTheOverlayByTheReferenceModeUnlessTold) {
  Parameters parameters;
  EXPECT_EQ(overlayStyleFrom(parameters), OverlayStyle::flow);
  parameters.reference_mode = "fixed";
  EXPECT_EQ(overlayStyleFrom(parameters), OverlayStyle::side_by_side);
  parameters.overlay_style = "difference";
  EXPECT_EQ(overlayStyleFrom(parameters), OverlayStyle::difference);
  parameters.overlay_style = "curtain";
  EXPECT_THROW(overlayStyleFrom(parameters), std::invalid_argument);
}

TEST(Parameters, TheCoreTakesBothEndsOfEveryRange) {
  for (const ParameterRow& row : parameterRows()) {
    if (row.limits.text().empty() || row.name == "threads") continue;  // no 256 threads here
    for (const double bound : {row.limits.low(), row.limits.high()}) {
      Parameters p;
      std::visit(
          [&](auto field) {
            if constexpr (std::is_arithmetic_v<std::decay_t<decltype(p.*field)>>) {
              p.*field = static_cast<std::decay_t<decltype(p.*field)>>(bound);
            }
          },
          row.field);
      EXPECT_NO_THROW({
        const PipelineOptions options = pipelineOptions(p);
        const OrbExtractor extractor(options.orb);
        const KtgpMatcher matcher(options.matcher);
      }) << row.name
         << " = " << bound;
    }
  }
}

TEST(Parameters, NanIsRefusedWhereverThereIsANumber) {
  int numbers = 0;
  for (const ParameterRow& row : parameterRows()) {
    Parameters p;
    if (valueOf(row, p) == nullptr) continue;
    ++numbers;
    p.*std::get<double Parameters::*>(row.field) = std::numeric_limits<double>::quiet_NaN();
    const std::string said = test::refusalOf([&] { requireValid(p); });
    for (const std::string& words : {row.name + " is nan", row.limits.text()}) {
      test::expectSays(said, words);
    }
  }
  EXPECT_GE(numbers, 8);
}

TEST(NearName, IsTheOneWithTheFewestChangesAndAnyCase) {
  const std::vector<std::string> names = {"T_w", "T_G", "features", "gms", "gms_rotation"};
  EXPECT_EQ(hintOnName("t_w", names), "; did you mean T_w?");
  EXPECT_EQ(hintOnName("TG", names), "; did you mean T_G?");
  EXPECT_EQ(hintOnName("faetures", names), "; did you mean features?");
  EXPECT_EQ(hintOnName("gms-rotation", names), "; did you mean gms_rotation?");
}

TEST(NearName, NamesWithLittleInCommonAreNoHint) {
  for (const char* name : {"", "x", "lazy", "threads"}) {
    EXPECT_EQ(hintOnName(name, {"T_w", "features", "gms"}), "") << name;
  }
  EXPECT_EQ(hintOnName(std::string(1000, 'f'), {std::string(1000, 'f')}), "");
  EXPECT_EQ(hintOnName("--max_latency", {"--max_rate"}), "");
  EXPECT_EQ(hintOnName("features", {}), "");
}

TEST(Parameters, NamesAreUniqueAndEveryOneReadsBack) {
  std::set<std::string> names;
  for (const ParameterRow& row : parameterRows()) {
    EXPECT_TRUE(names.insert(row.name).second) << row.name;
    EXPECT_EQ(findParameter(row.name), &row);
    Parameters p;
    p.T_w = 0.1;
    const std::string text = valueText(row, p);
    setParameter(row, text, p);
    EXPECT_EQ(valueText(row, p), text) << row.name;
  }
  EXPECT_EQ(findParameter("T_W"), nullptr);
}

TEST(Parameters, NumbersReadBackToTheLastBit) {
  const ParameterRow& row = *findParameter("T_w");
  for (const double value : {0.66, 1.0 / 3.0, 0.1 + 0.2, std::nextafter(0.5, 1.0)}) {
    Parameters p;
    p.T_w = value;
    const std::string text = valueText(row, p);
    p.T_w = 0.9;
    setParameter(row, text, p);
    EXPECT_EQ(p.T_w, value) << text;
  }
  Parameters p;
  p.T_w = 0.66;
  EXPECT_EQ(valueText(row, p), "0.66");
}

TEST(Parameters, TextThatIsNoValueIsRefused) {
  Parameters p;
  const auto refuses = [&](const char* name, const char* text) {
    EXPECT_THROW(setParameter(*findParameter(name), text, p), std::invalid_argument)
        << name << " = " << text;
  };
  for (const char* text : {"", "x", "0.5 ", "0.5x", "nan", "inf", "-0.1", "1.5"})
    refuses("T_w", text);
  for (const char* text : {"", "1.5", "1e3", "99999999999", "0"}) refuses("features", text);
  for (const char* text : {"", "1", "True", "no"}) refuses("gms_scale", text);
  for (const char* text : {"", "slow", "orb "}) refuses("descriptor", text);
  EXPECT_EQ(p.T_w, Parameters{}.T_w);
  setParameter(*findParameter("T_w"), "1", p);
  EXPECT_EQ(p.T_w, 1.0);
}

}  // namespace
}  // namespace ktgp_orb
