#include <optional>
#include <stdexcept>

#include "ktgp_orb/knn_matcher.h"
#include "matching/knn/near_search.h"
#include "matching/knn/search.h"
#include "util/options_check.h"

namespace ktgp_orb {
struct KnnMatcher::Impl {
  explicit Impl(const KnnOptions& given)
      : options(given), search(knn::bestKnnKernel(), given.threads) {
    if (options.search_radius > 0.0) {
      near.emplace(knn::bestKnnKernel(), options.search_radius, search.pool());
    }
  }

  const KnnOptions options;
  knn::KnnSearch search;
  std::optional<knn::NearSearch> near;  // empty if no search radius is given
};

KnnMatcher::KnnMatcher(const KnnOptions& options) {
  util::requireInRange("search_radius", options.search_radius, 0.0, 10000.0);
  impl_ = std::make_unique<Impl>(options);
}

KnnMatcher::~KnnMatcher() = default;
KnnMatcher::KnnMatcher(KnnMatcher&&) noexcept = default;
KnnMatcher& KnnMatcher::operator=(KnnMatcher&&) noexcept = default;

const KnnOptions& KnnMatcher::options() const {
  return impl_->options;
}

void KnnMatcher::match(const cv::Mat& reference, const cv::Mat& target,
                       std::vector<Correspondence>& correspondences) {
  impl_->search.match(reference, target, false, correspondences);
}

void KnnMatcher::matchMutual(const cv::Mat& reference, const cv::Mat& target,
                             std::vector<Correspondence>& correspondences) {
  impl_->search.match(reference, target, true, correspondences);
}

void KnnMatcher::matchNear(const Features& reference, const Features& target,
                           const Eigen::Matrix3d& prediction, bool mutual,
                           std::vector<Correspondence>& correspondences) {
  requireValid(reference, "reference");
  requireValid(target, "target");
  requireSameDescriptor(reference, target);
  if (!impl_->near) {
    throw std::invalid_argument(
        "search_radius is 0; expected a radius above 0 px for a search "
        "near the predicted positions");
  }
  impl_->near->match(reference, target, prediction, mutual, correspondences);
}

}  // namespace ktgp_orb
