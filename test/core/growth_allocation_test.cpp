// The growth allocates nothing in steady state.
#include <gtest/gtest.h>

#include <opencv2/imgproc.hpp>

#include "allocation_counter.h"
#include "ktgp_orb/growth.h"
#include "ktgp_orb/knn_matcher.h"
#include "ktgp_orb/orb_extractor.h"

namespace ktgp_orb {
namespace {

cv::Mat noise(int seed) {
  cv::Mat coarse(60, 80, CV_8U), image;
  cv::RNG(static_cast<std::uint64_t>(seed)).fill(coarse, cv::RNG::UNIFORM, 0, 256);
  cv::resize(coarse, image, {640, 480}, 0.0, 0.0, cv::INTER_NEAREST);
  cv::GaussianBlur(image, image, {}, 1.5);
  return image;
}

TEST(GrowthAllocation, NothingInTheSteadyState) {
  OrbExtractor extractor;
  Features reference, target;
  extractor.extract(noise(1), reference);
  extractor.extract(noise(2), target);
  const ReferenceViews views = simulateViews(noise(1), extractor.options(), 5);
  KnnMatcher knn;
  std::vector<Correspondence> matches;
  knn.matchMutual(reference.descriptors, target.descriptors, matches);
  HomographyGrowth growth;
  GrowthResult result;
  growth.find(reference, &views, target, matches, result);
  ASSERT_GT(result.seeds, 0);
  const test::AllocationCounter counter;
  growth.find(reference, &views, target, matches, result);
  EXPECT_EQ(counter.count(), 0U);
}

}  // namespace
}  // namespace ktgp_orb
