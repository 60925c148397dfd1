#include "ktgp_orb/knn_matcher.h"

#include "core/knn/search.h"

namespace ktgp_orb {

struct KnnMatcher::Impl {
  explicit Impl(const KnnOptions& given) : options(given), search(bestKnnKernel(), given.threads) {}
  const KnnOptions options;
  KnnSearch search;
};

KnnMatcher::KnnMatcher(const KnnOptions& options) : impl_(std::make_unique<Impl>(options)) {}

KnnMatcher::~KnnMatcher() = default;
KnnMatcher::KnnMatcher(KnnMatcher&&) noexcept = default;
KnnMatcher& KnnMatcher::operator=(KnnMatcher&&) noexcept = default;

const KnnOptions& KnnMatcher::options() const {
  return impl_->options;
}

void KnnMatcher::match(const cv::Mat& reference, const cv::Mat& target,
                       std::vector<Correspondence>& correspondences) {
  impl_->search.match(reference, target, correspondences);
}

void KnnMatcher::matchMutual(const cv::Mat& reference, const cv::Mat& target,
                             std::vector<Correspondence>& correspondences) {
  impl_->search.matchMutual(reference, target, correspondences);
}

}  // namespace ktgp_orb
