// Real matches: the paper's pairs must keep the expected matches, unrelated images none.

#include <gtest/gtest.h>

#include <cstdint>
#include <opencv2/features2d.hpp>
#include <opencv2/imgcodecs.hpp>
#include <string>
#include <vector>

#include "ktgp_orb/ktgp_matcher.h"
#include "test_data.h"

namespace ktgp_orb {
namespace {

Features extract(const std::string& set, int number) {
  const cv::Mat image = test::oxfordImage(set, number);
  Features features;
  features.image_size = image.size();
  cv::ORB::create(2000)->detectAndCompute(image, cv::noArray(), features.keypoints,
                                          features.descriptors);
  return features;
}

struct Expected {
  const char* set;
  int image;
  int ktgp;  // with OpenCV's parts
};

TEST(ProsacOnOxford, KeepsAsManyMatchesAsThePaperPairsHave) {
  KTGP_ORB_REQUIRE_FOLDER(test::dataFolder(), "KTGP_ORB_DATA");
  KtgpMatcher matcher;
  MatchResult result;
  for (const Expected& e : {Expected{"leuven", 2, 743},
                            {"leuven", 3, 510},
                            {"leuven", 4, 415},
                            {"leuven", 5, 357},
                            {"leuven", 6, 272},
                            {"bikes", 2, 890},
                            {"bikes", 3, 746},
                            {"bikes", 4, 394},
                            {"bikes", 5, 267},
                            {"bikes", 6, 132}}) {
    matcher.match(extract(e.set, 1), extract(e.set, e.image), result);
    ASSERT_EQ(result.status, Status::ok) << e.set << e.image;
    EXPECT_NEAR(static_cast<double>(result.prosac.inliers), e.ktgp, 4.0) << e.set << e.image;
    // The levels are the mask, in order, and nothing else.
    std::vector<std::uint8_t> reached;
    for (const Correspondence& c : result.correspondences) {
      if (c.level >= Level::ktg) reached.push_back(c.level == Level::ktgp ? 1 : 0);
    }
    EXPECT_EQ(reached, result.prosac.mask) << e.set << e.image;
    EXPECT_EQ(countAtLeast(result.correspondences, Level::ktgp), result.prosac.inliers);
  }
}

TEST(ProsacOnOxford, FindsNothingBetweenUnrelatedImages) {
  KTGP_ORB_REQUIRE_FOLDER(test::dataFolder(), "KTGP_ORB_DATA");
  MatcherOptions options;
  options.ratio_threshold = 0.95;  // hundreds of wrong matches
  options.gms.threshold = 0.0;
  KtgpMatcher matcher(options);
  MatchResult result;
  for (int k = 1; k <= 6; k += 5) {
    const Features leuven = extract("leuven", k);
    const Features bikes = extract("bikes", k);
    const Features boat = extract("boat", k);
    for (const auto& [a, b] : {std::pair(&leuven, &bikes), {&bikes, &boat}, {&boat, &leuven}}) {
      matcher.match(*a, *b, result);
      EXPECT_NE(result.status, Status::ok);
    }
  }
}

}  // namespace
}  // namespace ktgp_orb
