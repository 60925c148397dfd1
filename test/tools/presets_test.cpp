// Compares the defaults and the presets in config/ with those of the core.
#include <gtest/gtest.h>

#include <string>

#include "ktgp_orb/pair_matcher.h"
#include "parameters/options.h"
#include "tools/parameter_file.h"

namespace ktgp_orb {
namespace {

void expectEqual(const MatcherOptions& preset, const MatcherOptions& core,
                 DescriptorKind descriptor = DescriptorKind::orb) {
  EXPECT_EQ(preset.knn.threads, core.knn.threads);
  EXPECT_EQ(preset.knn.search_radius, core.knn.search_radius);
  EXPECT_EQ(preset.mutual, core.mutual);
  EXPECT_EQ(preset.ratio_threshold, core.ratio_threshold.value_or(ratioThreshold(descriptor)));
  EXPECT_EQ(preset.gms.enabled, core.gms.enabled);
  EXPECT_EQ(preset.gms.threshold, core.gms.threshold);
  EXPECT_EQ(preset.gms.rotation, core.gms.rotation);
  EXPECT_EQ(preset.gms.scale, core.gms.scale);
  EXPECT_EQ(preset.gms.grid_columns, core.gms.grid_columns);
  EXPECT_EQ(preset.gms.grid_rows, core.gms.grid_rows);
  EXPECT_EQ(preset.prosac.max_error, core.prosac.max_error);
  EXPECT_EQ(preset.prosac.max_iterations, core.prosac.max_iterations);
  EXPECT_EQ(preset.prosac.confidence, core.prosac.confidence);
  EXPECT_EQ(preset.prosac.seed, core.prosac.seed);
  EXPECT_EQ(preset.growth.enabled, core.growth.enabled);
  EXPECT_EQ(preset.growth.seeds, core.growth.seeds);
  EXPECT_EQ(preset.growth.views, core.growth.views);
  EXPECT_EQ(preset.guided.enabled, core.guided.enabled);
  EXPECT_EQ(preset.guided.radius, core.guided.radius);
  EXPECT_EQ(preset.alignment.enabled, core.alignment.enabled);
  EXPECT_EQ(preset.alignment.points, core.alignment.points);
  EXPECT_EQ(preset.geometry, core.geometry);
  if (core.geometry == GeometryModel::homography) return;
  EXPECT_EQ(preset.shared_errors, core.shared_errors);
}

TEST(Presets, EqualTheCoreOptions) {
  EXPECT_EQ(pipelineOptions({}).orb, OrbOptions{});
  expectEqual(pipelineOptions({}).matcher, MatcherOptions{});
  const auto expectPreset = [](const std::string& name, const MatcherOptions& core,
                               DescriptorKind descriptor = DescriptorKind::orb) {
    SCOPED_TRACE(name);
    Parameters parameters;
    tools::readPreset(name, parameters);
    expectEqual(pipelineOptions(parameters).matcher, core, descriptor);
  };
  expectPreset("ktgp", MatcherOptions::ktgp());
  expectPreset("robust", MatcherOptions::robust());
  expectPreset("slam", MatcherOptions::slam());
  expectPreset("teblid", MatcherOptions::ktgp(), DescriptorKind::teblid);
  const PairOptions photo = PairOptions::photo();
  expectPreset("photo", photo.matcher, photo.orb.descriptor);
  Parameters named;
  tools::readPreset("photo", named);
  EXPECT_EQ(pipelineOptions(named).orb, photo.orb);
  MatcherOptions video;
  video.knn.search_radius = 48.0;
  expectPreset("video", video);
}

/// Only video says nothing about how far views may differ.
TEST(Presets, FixedReferenceDoesNotChangePresets) {
  for (const char* name : {"ktgp", "photo", "robust", "slam", "teblid", "video"}) {
    SCOPED_TRACE(name);
    Parameters parameters;
    tools::readPreset(name, parameters);
    const SequenceOptions preset = sequenceOptions(parameters);
    parameters.reference_mode = "fixed";
    const SequenceOptions fixed = sequenceOptions(parameters);
    if (name == std::string("video")) {
      EXPECT_TRUE(fixed.matcher.growth.enabled);
      continue;
    }
    EXPECT_EQ(noteOnFixed(parameters), "");
    EXPECT_EQ(fixed.orb, preset.orb);
    expectEqual(fixed.matcher, preset.matcher, preset.orb.descriptor);
    parameters.features = 1000;
    EXPECT_EQ(sequenceOptions(parameters).matcher.gms.enabled, preset.matcher.gms.enabled);
  }
}

}  // namespace
}  // namespace ktgp_orb
