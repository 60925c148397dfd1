#include "ktgp_orb/pair_matcher.h"

#include <algorithm>
#include <chrono>

#include "util/milliseconds.h"

namespace ktgp_orb {
namespace {

/// Returns the feature options for an image with this number of pixels.
OrbOptions orbFor(const PairOptions& options, std::size_t pixels) {
  // Maximum number of features; the time for matching grows with the square of this number.
  constexpr int kMost = 8000;
  // With 4000 instead of 2000 features, 91 instead of 56 % of 45 pairs of photographs of a building
  // have a motion (reichstag, doc/measurements/two_view.md).
  constexpr int kLeastWithDepth = 4000;
  OrbOptions orb = options.orb;
  if (!options.features_by_area) return orb;
  const bool plane = options.matcher.geometry == GeometryModel::homography;
  const int base = plane ? orb.max_features : std::max(orb.max_features, kLeastWithDepth);
  const double megapixels = std::max(1.0, 1e-6 * static_cast<double>(pixels));
  orb.max_features = std::max(base, static_cast<int>(std::min<double>(kMost, base * megapixels)));
  return orb;
}

double extract(OrbExtractor& extractor, const cv::Mat& image, Features& features) {
  const auto start = std::chrono::steady_clock::now();
  extractor.extract(image, features);
  return util::millisecondsSince(start);
}

}  // namespace

PairOptions PairOptions::photo() {
  PairOptions options;
  options.orb.max_features = 3000;
  options.orb.fast_threshold = 10;
  options.orb.descriptor = DescriptorKind::teblid;
  options.matcher = MatcherOptions::robust();
  options.matcher.growth.views = 13;
  options.features_by_area = true;
  return options;
}

PairMatch matchPair(const cv::Mat& reference, const cv::Mat& target, const PairOptions& options,
                    const MatchHints& hints) {
  const OrbOptions orb = orbFor(options, std::max(reference.total(), target.total()));
  OrbExtractor extractor(orb);
  KtgpMatcher matcher(options.matcher);
  PairMatch pair;
  pair.max_features = orb.max_features;
  pair.reference_milliseconds = extract(extractor, reference, pair.reference);
  pair.target_milliseconds = extract(extractor, target, pair.target);
  matcher.match(pair.reference, pair.target, hints, pair.match);
  const GrowthOptions& growth = options.matcher.growth;
  if (pair.match.status == Status::ok || !growth.enabled || growth.views == 0) return pair;
  const ReferenceViews views = simulateViews(reference, orb, growth.views);
  MatchHints with_views = hints;
  with_views.views = &views;
  matcher.match(pair.reference, pair.target, with_views, pair.match);
  return pair;
}

}  // namespace ktgp_orb
