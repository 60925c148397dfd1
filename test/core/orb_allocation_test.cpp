#include <gtest/gtest.h>

#include "allocation_counter.h"
#include "ktgp_orb/orb_extractor.h"
#include "orb_test_images.h"

namespace ktgp_orb {
namespace {

TEST(OrbExtractor, AllocatesNothingOnceItsBuffersHaveGrown) {
  const cv::Mat images[] = {test::textureImage(cv::Size(640, 480), 1),
                            test::textureImage(cv::Size(640, 480), 2)};
  for (KeypointDistribution distribution :
       {KeypointDistribution::ranked, KeypointDistribution::uniform}) {
    for (int i = 0; i < 4; ++i) {
      OrbOptions options;
      options.distribution = distribution;
      options.threads = i % 2 == 0 ? 1 : 3;
      options.descriptor = i < 2 ? DescriptorKind::orb : DescriptorKind::teblid;
      OrbExtractor extractor(options);
      Features features;
      for (int k = 0; k < 4; ++k) extractor.extract(images[k % 2], features);
      const auto* pixels = features.descriptors.data;
      const test::AllocationCounter counter;
      for (int k = 0; k < 6; ++k) extractor.extract(images[k % 2], features);
      EXPECT_EQ(counter.count(), 0u)
          << options.threads << " threads, " << toString(options.descriptor);
      // cv::Mat does not allocate by operator new: the descriptors must not have moved.
      EXPECT_EQ(features.descriptors.data, pixels);
    }
  }
}

TEST(OrbExtractor, LeavesDescriptorsAloneThatSomebodyElseHolds) {
  OrbExtractor extractor;
  Features features;
  extractor.extract(test::textureImage(cv::Size(320, 240), 3), features);
  const Features kept = features;
  const cv::Mat copy = kept.descriptors.clone();
  extractor.extract(test::textureImage(cv::Size(320, 240), 4), features);
  EXPECT_EQ(cv::norm(kept.descriptors, copy, cv::NORM_INF), 0.0);
}

}  // namespace
}  // namespace ktgp_orb
