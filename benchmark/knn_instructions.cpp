// Runs one search so many times, and nothing else: for counting its instructions where there is no
// clock to trust (scripts/count_arm64_instructions).
//   knn_instructions --list                 the kernels of this processor, one a line
//   knn_instructions KERNEL near|whole|mutual N CALLS
//   knn_instructions BFMatcher whole N CALLS
// Descriptors are generated: N in either frame, spread over 640x480; "near" is a radius of 48 px.

#include <cstdio>
#include <cstdlib>
#include <opencv2/core.hpp>
#include <opencv2/features2d.hpp>
#include <stdexcept>
#include <string>
#include <vector>

#include "core/knn/near_search.h"
#include "core/knn/search.h"
#include "instruction_sets.h"

namespace ktgp_orb {
namespace {

using knn::bestKnnKernel;
using knn::bestNearKernel;
using knn::KnnKernel;
using knn::KnnSearch;
using knn::NearSearch;
using knn::portableKnnKernel;
using knn::portableNearKernel;

Features generated(int count, std::uint64_t seed) {
  Features features;
  features.image_size = {640, 480};
  features.descriptors.create(count, kDescriptorBytes, CV_8U);
  cv::RNG random(seed);
  random.fill(features.descriptors, cv::RNG::UNIFORM, 0, 256);
  for (int i = 0; i < count; ++i) {
    features.keypoints.emplace_back(random.uniform(0.F, 640.F), random.uniform(0.F, 480.F), 31.F);
  }
  return features;
}

template <typename Kernel>
const Kernel& kernelNamed(const std::string& name, const Kernel& (*best)(),
                          const Kernel& portable) {
  for (const Kernel* kernel : test::everyKernels(best, portable)) {
    if (name == kernel->name) return *kernel;
  }
  throw std::invalid_argument("no kernel is called " + name + "; --list names them");
}

void run(const std::string& name, const std::string& what, int count, int calls) {
  Features reference = generated(count, 1);
  const Features target = generated(count, 2);
  std::vector<Correspondence> found;
  std::vector<std::vector<cv::DMatch>> matches;
  const bool opencv = name == "BFMatcher";
  KnnSearch whole(
      opencv ? portableKnnKernel() : kernelNamed(name, bestKnnKernel, portableKnnKernel()), 1);
  NearSearch near(
      opencv ? portableNearKernel() : kernelNamed(name, bestNearKernel, portableNearKernel()), 48.0,
      whole.pool());
  for (int i = 0; i < calls; ++i) {
    *reference.descriptors.data ^= 1;  // another reference, which has to be laid out anew
    if (opencv) {
      cv::BFMatcher(cv::NORM_HAMMING)
          .knnMatch(target.descriptors, reference.descriptors, matches, 2);
    } else if (what == "near") {
      near.match(reference, target, Eigen::Matrix3d::Identity(), false, found);
    } else if (what == "mutual") {
      whole.matchMutual(reference.descriptors, target.descriptors, found);
    } else {
      whole.match(reference.descriptors, target.descriptors, found);
    }
  }
}

}  // namespace
}  // namespace ktgp_orb

int main(int argc, char** argv) {
  using namespace ktgp_orb;
  cv::setNumThreads(1);
  if (argc == 2 && std::string(argv[1]) == "--list") {
    for (const KnnKernel* kernel : test::everyKernels(bestKnnKernel, portableKnnKernel())) {
      std::printf("%s\n", kernel->name);
    }
    return 0;
  }
  if (argc != 5) {
    std::fprintf(stderr, "knn_instructions KERNEL|BFMatcher whole|mutual|near N CALLS\n");
    return 2;
  }
  try {
    run(argv[1], argv[2], std::atoi(argv[3]), std::atoi(argv[4]));
  } catch (const std::exception& error) {
    std::fprintf(stderr, "%s\n", error.what());
    return 2;
  }
  return 0;
}
