// Every stage keeps its options, also after it was moved.
#include <gtest/gtest.h>

#include <utility>

#include "ktgp_orb/ktgp_matcher.h"
#include "ktgp_orb/orb_extractor.h"

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

}  // namespace
}  // namespace ktgp_orb
