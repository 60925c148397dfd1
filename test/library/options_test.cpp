// Every stage keeps its options, also after it was moved, and refuses those outside of their range.
#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "ktgp_orb/ground_motion.h"
#include "ktgp_orb/growth.h"
#include "ktgp_orb/mosaic.h"
#include "ktgp_orb/sequence_matcher.h"
#include "ktgp_orb/stabilizer.h"
#include "ktgp_orb/target_finder.h"

namespace ktgp_orb {
namespace {

template <typename Stage, typename Options>
Stage madeAndMoved(const Options& options) {
  Stage first(options);
  Stage moved(std::move(first));
  Stage assigned;
  assigned = std::move(moved);
  return assigned;
}

TEST(Options, AreKeptByEveryStage) {
  OrbOptions orb;
  orb.max_features = 17;
  EXPECT_EQ(madeAndMoved<OrbExtractor>(orb).options(), orb);

  MatcherOptions matcher;
  matcher.knn.threads = 2;
  matcher.ratio_threshold = 0.7;
  matcher.gms.threshold = 5.0;
  matcher.prosac.max_error = 2.0;
  EXPECT_EQ(madeAndMoved<KnnMatcher>(matcher.knn).options().threads, 2);
  EXPECT_EQ(madeAndMoved<GmsFilter>(matcher.gms).options().threshold, 5.0);
  EXPECT_EQ(madeAndMoved<ProsacHomography>(matcher.prosac).options().max_error, 2.0);

  const KtgpMatcher all(matcher);
  EXPECT_EQ(all.options().knn.threads, 2);
  EXPECT_EQ(all.options().ratio_threshold, 0.7);
  EXPECT_EQ(all.options().gms.threshold, 5.0);
  EXPECT_EQ(all.options().prosac.max_error, 2.0);
}

/// After each of the changes by itself, numbered from 0.
template <typename Stage, typename Options>
void expectRefused(const std::string& stage,
                   const std::vector<std::function<void(Options&)>>& changes) {
  EXPECT_NO_THROW(Stage{Options{}}) << stage;
  for (std::size_t i = 0; i < changes.size(); ++i) {
    Options options;
    changes[i](options);
    EXPECT_THROW(Stage{options}, std::invalid_argument) << stage << ", change " << i;
  }
}

TEST(Options, OutsideOfTheirRangeAreRefused) {
  const double nan = std::nan("");
  expectRefused<OrbExtractor, OrbOptions>(
      "orb", {[](auto& o) { o.max_features = 0; }, [](auto& o) { o.scale_factor = 1.0; },
              [=](auto& o) { o.scale_factor = nan; }, [](auto& o) { o.levels = 17; },
              [](auto& o) { o.fast_threshold = 0; }, [](auto& o) { o.threads = -1; },
              [](auto& o) { o.first_level = -1; }, [](auto& o) { o.first_level = 8; },
              [](auto& o) {
                o.first_level = 3;
                o.descriptor = DescriptorKind::teblid;
              }});
  expectRefused<KnnMatcher, KnnOptions>(
      "knn", {[](auto& o) { o.threads = -1; }, [](auto& o) { o.search_radius = -1.0; },
              [=](auto& o) { o.search_radius = nan; }});
  expectRefused<GmsFilter, GmsOptions>(
      "gms", {[](auto& o) { o.threshold = -0.1; }, [](auto& o) { o.threshold = 1.1e6; },
              [=](auto& o) { o.threshold = nan; }, [](auto& o) { o.grid_columns = -1; },
              [](auto& o) { o.grid_columns = 201; }, [](auto& o) { o.grid_rows = -1; },
              [](auto& o) { o.grid_rows = 201; }});
  expectRefused<ProsacHomography, ProsacOptions>(
      "prosac", {[](auto& o) { o.max_error = 0.0; }, [=](auto& o) { o.max_error = nan; },
                 [](auto& o) { o.max_iterations = 0; }, [](auto& o) { o.confidence = 1.0; },
                 [](auto& o) { o.confidence = 0.0; }});
  expectRefused<HomographyGrowth, GrowthOptions>(
      "growth", {[](auto& o) { o.seeds = 0; }, [](auto& o) { o.views = 14; }});
  expectRefused<GuidedMatcher, GuidedOptions>(
      "guided", {[](auto& o) { o.radius = 0.0; }, [](auto& o) { o.max_distance = 257; }});
  expectRefused<Alignment, AlignmentOptions>("alignment", {[](auto& o) { o.points = 11; }});
  expectRefused<KtgpMatcher, MatcherOptions>("matcher", {[](auto& o) { o.ratio_threshold = 0.0; },
                                                         [](auto& o) { o.ratio_threshold = 1.1; }});
  expectRefused<Stabilizer, StabilizerOptions>(
      "stabilizer", {[](auto& o) { o.max_crop = 0.5; }, [](auto& o) { o.lag = -1; },
                     [=](auto& o) { o.strength = nan; }});
  expectRefused<Mosaic, MosaicOptions>("mosaic", {[](auto& o) { o.max_megapixels = 0.0; }});
  expectRefused<GroundMotion, GroundMotionOptions>("motion",
                                                   {[](auto& o) { o.ground_slope = -1.0; }});
  expectRefused<TargetFinder, TargetFinderOptions>("targets", {[](auto& o) { o.views = 3; },
                                                               [](auto& o) {
                                                                 o.views = 5;
                                                                 o.orb.first_level = 2;
                                                               }});
}

const std::vector<std::function<void(SequenceOptions&)>> kOfNoSequence{
    [](auto& o) { o.reference.max_age = std::nan(""); },
    [](auto& o) { o.reference.max_age = 0.0; },
    [](auto& o) { o.reference.min_overlap = std::nan(""); },
    [](auto& o) { o.reference.min_overlap = 1.1; },
    [](auto& o) { o.reference.min_inliers = 3; },
    [](auto& o) { o.reference.enlarge_below = -1; },
    [](auto& o) { o.orb.levels = 0; },
    [](auto& o) { o.matcher.ratio_threshold = 2.0; }};

TEST(Options, RefusedSequenceOptionsKeepTheOldOnes) {
  expectRefused<SequenceMatcher, SequenceOptions>("sequence", kOfNoSequence);
  for (const auto& change : kOfNoSequence) {
    SequenceOptions options;
    change(options);
    SequenceMatcher matcher;
    EXPECT_THROW(matcher.setOptions(options), std::invalid_argument);
    EXPECT_EQ(matcher.options().reference.max_age, 1.0);
  }
}

}  // namespace
}  // namespace ktgp_orb
