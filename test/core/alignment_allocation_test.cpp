#include <gtest/gtest.h>

#include "alignment_scene.h"
#include "allocation_counter.h"
#include "ktgp_orb/alignment.h"

namespace ktgp_orb {
namespace {

TEST(Alignment, AllocatesNothingOnceItsBuffersHaveGrown) {
  const Eigen::Matrix3d truth = test::turn(3.0, 1.05);
  const Eigen::Matrix3d start = test::translation(0.5, -0.5) * truth;  // something to improve
  const test::AlignmentScene scene = test::planeScene(1, truth);
  Alignment alignment;
  AlignmentResult result;
  const auto run = [&] {
    alignment.align(scene.reference, scene.target, scene.matches, test::uncertain(start), result);
  };
  run();
  ASSERT_EQ(result.status, AlignmentStatus::ok);
  const test::AllocationCounter counter;
  for (int i = 0; i < 5; ++i) run();
  EXPECT_EQ(counter.count(), 0u);
}

}  // namespace
}  // namespace ktgp_orb
