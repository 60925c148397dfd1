// Nearest neighbours, one way and both ways, against a plain search.
#include "core/knn/search.h"
#include "input.h"
#include "instruction_sets.h"

namespace ktgp_orb::fuzz {
namespace {

int hamming(const cv::Mat& a, int i, const cv::Mat& b, int j) {
  return static_cast<int>(cv::norm(a.row(i), b.row(j), cv::NORM_HAMMING));
}

std::vector<Correspondence> plain(const cv::Mat& reference, const cv::Mat& target) {
  std::vector<Correspondence> found;
  if (reference.rows == 0) return found;
  std::vector<int> best(static_cast<std::size_t>(reference.rows), 1000);
  std::vector<int> nearest(best.size(), -1);
  for (int t = 0; t < target.rows; ++t) {
    Correspondence c{-1, t, 1000, 1000, Level::knn, false};
    for (int r = 0; r < reference.rows; ++r) {
      const int distance = hamming(reference, r, target, t);
      const auto of = static_cast<std::size_t>(r);
      if (distance < best[of]) {
        best[of] = distance;
        nearest[of] = t;
      }
      if (distance < c.distance) {
        c.second_distance = c.distance;
        c.distance = distance;
        c.reference_index = r;
      } else if (distance < c.second_distance) {
        c.second_distance = distance;
      }
    }
    if (reference.rows == 1) c.second_distance = 0;
    found.push_back(c);
  }
  for (Correspondence& c : found) {
    c.mutual = nearest[static_cast<std::size_t>(c.reference_index)] == c.target_index;
  }
  return found;
}

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

void run(Input& in) {
  const cv::Mat reference = descriptors(in, in.ConsumeIntegralInRange(0, 150));
  const cv::Mat target = descriptors(in, in.ConsumeIntegralInRange(0, 100));
  const int threads = in.ConsumeIntegralInRange(1, 2);
  const auto expected = plain(reference, target);
  std::vector<Correspondence> found;
  for (const KnnKernel* kernel : test::everyKernels(&bestKnnKernel, portableKnnKernel())) {
    KnnSearch search(*kernel, threads);
    search.match(reference, target, found);
    requireEqual(found, expected, false);
    search.matchMutual(reference, target, found);
    requireEqual(found, expected, true);
  }
}

}  // namespace
}  // namespace ktgp_orb::fuzz

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* bytes, std::size_t size) {
  ktgp_orb::fuzz::Input in(bytes, size);
  ktgp_orb::fuzz::run(in);
  return 0;
}
