// Nearest neighbours, in the whole image and near predicted positions, in one and both directions,
// compared with a plain search.
#include <Eigen/LU>

#include "input.h"
#include "instruction_sets.h"
#include "matching/knn/near_search.h"
#include "matching/knn/search.h"
#include "plain_search.h"

namespace ktgp_orb::fuzz {
namespace {

using knn::bestKnnKernel;
using knn::KnnSearch;
using knn::NearSearch;
using knn::portableKnnKernel;
using util::ThreadPool;

void requireEqual(const std::vector<Correspondence>& a, const std::vector<Correspondence>& b,
                  bool mutual) {
  require(a.size() == b.size(), "one for each target");
  for (std::size_t i = 0; i < a.size(); ++i) {
    require(a[i].reference_index == b[i].reference_index, "the nearest");
    require(a[i].target_index == b[i].target_index, "in target order");
    require(a[i].distance == b[i].distance, "its distance");
    require(a[i].second_distance == b[i].second_distance, "the second distance");
    require(!mutual || a[i].mutual == b[i].mutual, "mutual");
  }
}

template <typename Kernel>
const Kernel& any(Input& in, const std::vector<const Kernel*>& kernels) {
  return *kernels[in.ConsumeIntegralInRange<std::size_t>(0, kernels.size() - 1)];
}

void searchAll(Input& in, const Features& reference, const Features& target) {
  static const auto kernels = test::everyKernels(&bestKnnKernel, portableKnnKernel());
  const auto expected = test::plainSearch(reference.descriptors, target.descriptors, true);
  std::vector<Correspondence> found;
  KnnSearch search(any(in, kernels), threads(in));
  search.match(reference.descriptors, target.descriptors, false, found);
  requireEqual(found, expected, false);
  search.match(reference.descriptors, target.descriptors, true, found);
  requireEqual(found, expected, true);
}

void searchNear(Input& in, const Features& reference, const Features& target) {
  static const auto kernels = test::everyKernels(&bestKnnKernel, portableKnnKernel());
  const bool any_radius = in.ConsumeIntegralInRange(0, 15) == 0;  // small ones make many cells
  const double radius = any_radius ? in.ConsumeFloatingPointInRange(0.01, 5000.0)
                                   : in.ConsumeFloatingPointInRange(20.0, 500.0);
  const Eigen::Matrix3d prediction = homography(in, 50.0);
  ThreadPool pool(threads(in));
  NearSearch search(any(in, kernels), radius, pool);
  std::vector<Correspondence> found;
  search.match(reference, target, prediction, true, found);
  requireEqual(found, test::plainNearSearch(reference, target, prediction, radius, true), true);
}

void run(Input& in) {
  const Features reference = features(in, 200);
  const Features target = features(in, 150);
  if (in.ConsumeBool()) {
    searchAll(in, reference, target);
  } else {
    searchNear(in, reference, target);
  }
}

}  // namespace
}  // namespace ktgp_orb::fuzz

KTGP_ORB_FUZZ(ktgp_orb::fuzz::run)  // a prediction that cannot be inverted
