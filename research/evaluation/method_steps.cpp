#include "evaluation/method_steps.h"

#include <algorithm>
#include <cmath>
#include <memory>
#include <opencv2/imgproc.hpp>

#include "ktgp_orb/metrics.h"
#include "ktgp_orb/ratio_filter.h"
#include "util/keypoint_position.h"

namespace ktgp_orb::evaluation {
namespace {

using util::position;

/// Removes matches; calls the predicate once per match, in order.
template <typename Predicate>
void removeIf(Predicate predicate, std::vector<Correspondence>& matches) {
  matches.erase(std::remove_if(matches.begin(), matches.end(), predicate), matches.end());
}

void dropBelow(Level level, std::vector<Correspondence>& matches) {
  removeIf([&](const Correspondence& c) { return c.level < level; }, matches);
}

void setLevel(Level level, std::vector<Correspondence>& matches) {
  for (Correspondence& c : matches) c.level = level;
}

cv::Mat referenceDescriptor(const Scene& scene, const Correspondence& c) {
  return scene.reference.descriptors.row(c.reference_index);
}

cv::Mat targetDescriptor(const Scene& scene, const Correspondence& c) {
  return scene.target.descriptors.row(c.target_index);
}

/// Mean grey value of the 9x9 px around a keypoint, in standard deviations from the image's mean.
double standardisedGrey(const cv::Mat& image, const cv::KeyPoint& keypoint, const cv::Scalar& mean,
                        const cv::Scalar& deviation) {
  constexpr int kSide = 9;
  const cv::Rect around(cvRound(keypoint.pt.x) - kSide / 2, cvRound(keypoint.pt.y) - kSide / 2,
                        kSide, kSide);
  const cv::Rect visible = around & cv::Rect({0, 0}, image.size());
  if (visible.empty() || deviation[0] <= 0.0) return 0.0;
  return (cv::mean(image(visible))[0] - mean[0]) / deviation[0];
}

}  // namespace

Step nearest(const KnnOptions& options) {
  auto knn = std::make_shared<KnnMatcher>(options);
  return {"knn", [knn](const Scene& scene, Matching& m) {
            knn->match(scene.reference.descriptors, scene.target.descriptors, m.matches);
          }};
}

Step mutualNearest(const KnnOptions& options) {
  auto knn = std::make_shared<KnnMatcher>(options);
  return {"mutual", [knn](const Scene& scene, Matching& m) {
            knn->matchMutual(scene.reference.descriptors, scene.target.descriptors, m.matches);
            removeIf([](const Correspondence& c) { return !c.mutual; }, m.matches);
          }};
}

Step ratio(double threshold) {
  return {"ratio", [threshold](const Scene&, Matching& m) {
            setLevel(Level::knn, m.matches);
            filterByRatio(threshold, m.matches);
            dropBelow(Level::kt, m.matches);
          }};
}

Step distanceThreshold(int floor) {
  return {"threshold", [floor](const Scene&, Matching& m) {
            int smallest = 8 * kDescriptorBytes;
            for (const Correspondence& c : m.matches) smallest = std::min(smallest, c.distance);
            const int most = std::max(2 * smallest, floor);
            const auto too_far = [most](const Correspondence& c) { return c.distance > most; };
            removeIf(too_far, m.matches);
          }};
}

Step bidirectional(const KnnOptions& options) {
  auto knn = std::make_shared<KnnMatcher>(options);
  auto back = std::make_shared<std::vector<Correspondence>>();
  return {"bidirectional", [knn, back](const Scene& scene, Matching& m) {
            knn->match(scene.target.descriptors, scene.reference.descriptors, *back);
            const auto one_way = [&](const Correspondence& c) {
              const auto r = static_cast<std::size_t>(c.reference_index);
              return (*back)[r].reference_index != c.target_index;
            };
            removeIf(one_way, m.matches);
          }};
}

Step cosineSimilarity(double threshold) {
  return {"cosine", [threshold](const Scene& scene, Matching& m) {
            const auto differs = [&](const Correspondence& c) {
              const double a = cv::norm(referenceDescriptor(scene, c), cv::NORM_HAMMING);
              const double b = cv::norm(targetDescriptor(scene, c), cv::NORM_HAMMING);
              const double common = 0.5 * (a + b - c.distance);  // number of ones that both have
              return common < threshold * std::sqrt(a * b);
            };
            removeIf(differs, m.matches);
          }};
}

Step similarNorm(double tolerance) {
  return {"norm", [tolerance](const Scene& scene, Matching& m) {
            const auto differs = [&](const Correspondence& c) {
              const double a = cv::norm(referenceDescriptor(scene, c), cv::NORM_L2);
              const double b = cv::norm(targetDescriptor(scene, c), cv::NORM_L2);
              return std::abs(a - b) > tolerance * std::max(a, b);
            };
            removeIf(differs, m.matches);
          }};
}

Step euclideanDistance() {
  return {"euclidean", [](const Scene& scene, Matching& m) {
            std::vector<double> distances;
            distances.reserve(m.matches.size());
            for (const Correspondence& c : m.matches) {
              distances.push_back(
                  cv::norm(referenceDescriptor(scene, c), targetDescriptor(scene, c), cv::NORM_L2));
            }
            const metrics::ErrorSummary s = metrics::summarize(distances);
            const double most = s.mean + std::sqrt(std::max(0.0, s.rms * s.rms - s.mean * s.mean));
            std::size_t i = 0;
            const auto too_far = [&](const Correspondence&) { return distances[i++] > most; };
            removeIf(too_far, m.matches);
          }};
}

Step greyLevel(double tolerance) {
  return {"grey", [tolerance](const Scene& scene, Matching& m) {
            cv::Scalar reference_mean, reference_deviation, target_mean, target_deviation;
            cv::meanStdDev(scene.reference_image, reference_mean, reference_deviation);
            cv::meanStdDev(scene.target_image, target_mean, target_deviation);
            const auto differs = [&](const Correspondence& c) {
              const auto r = static_cast<std::size_t>(c.reference_index);
              const auto t = static_cast<std::size_t>(c.target_index);
              const double a = standardisedGrey(scene.reference_image, scene.reference.keypoints[r],
                                                reference_mean, reference_deviation);
              const double b = standardisedGrey(scene.target_image, scene.target.keypoints[t],
                                                target_mean, target_deviation);
              return std::abs(a - b) > tolerance;
            };
            removeIf(differs, m.matches);
          }};
}

Step gms(const GmsOptions& options) {
  auto filter = std::make_shared<GmsFilter>(options);
  return {"gms", [filter](const Scene& scene, Matching& m) {
            setLevel(Level::kt, m.matches);
            filter->filter(scene.reference, scene.target, m.matches);
            dropBelow(Level::ktg, m.matches);
          }};
}

Step gmsOver(const Neighbourhood& neighbourhood, const GmsOptions& options) {
  return {"gms", [neighbourhood, options](const Scene& scene, Matching& m) {
            filterByGridStatistics(scene.reference, scene.target, neighbourhood, options,
                                   m.matches);
          }};
}

Step homography(const std::string& estimator, const ProsacOptions& options) {
  return {estimator, [estimator, options](const Scene& scene, Matching& m) {
            const Features& reference = m.own ? m.own->reference : scene.reference;
            const Features& target = m.own ? m.own->target : scene.target;
            PointPairs pairs;
            pairs.rounding = util::kKeypointRounding;
            for (const Correspondence& c : m.matches) {
              pairs.add(position(reference, c.reference_index), position(target, c.target_index),
                        c.ratio());
            }
            const ProsacResult model =
                estimateHomography(estimator, pairs, reference.image_size, options);
            m.estimated = true;
            m.candidates = m.matches;
            const bool found = model.status == Status::ok;
            if (found) m.answer = model.answer;
            std::size_t i = 0;
            const auto is_outlier = [&](const Correspondence&) {
              return !found || model.mask[i++] == 0;
            };
            removeIf(is_outlier, m.matches);
          }};
}

Step align(const MatcherOptions& options) {
  auto alignment = std::make_shared<Alignment>(options.alignment, options.prosac.max_error);
  auto result = std::make_shared<AlignmentResult>();
  return {"align", [alignment, result, max_error = options.prosac.max_error](const Scene& scene,
                                                                             Matching& m) {
            if (!m.answer) return;
            UncertainHomography start{m.answer->homography, m.answer->covariance};
            // Without an estimate, assumes a deviation of 1 for every entry.
            if (!start.covariance.allFinite()) start.covariance.setIdentity();
            alignment->align(scene.reference, scene.target, m.matches, start, *result);
            if (result->status != AlignmentStatus::ok) return;
            m.answer = result->answer;
            m.matches = m.candidates;
            const auto is_outlier = [&](const Correspondence& c) {
              return !(reprojectionError(m.answer->homography,
                                         position(scene.reference, c.reference_index),
                                         position(scene.target, c.target_index)) < max_error);
            };
            removeIf(is_outlier, m.matches);
          }};
}

OrbOptions withImages(OrbOptions options) {
  options.images = ImageKeeping::share;
  return options;
}

Step extract(const OrbOptions& options) {
  auto extractor = std::make_shared<OrbExtractor>(withImages(options));
  return {"extract", [extractor](const Scene& scene, Matching& m) {
            m.own.emplace();
            extractor->extract(scene.reference_image, m.own->reference);
            extractor->extract(scene.target_image, m.own->target);
          }};
}

Step matcher(const MatcherOptions& options) {
  auto chain = std::make_shared<KtgpMatcher>(options);
  auto result = std::make_shared<MatchResult>();
  return {"matcher", [chain, result](const Scene& scene, Matching& m) {
            MatchHints hints;
            hints.views = &m.views;
            chain->match(m.own ? m.own->reference : scene.reference,
                         m.own ? m.own->target : scene.target, hints, *result);
            result->surviving(Level::ktgp, m.matches);
            m.matches.insert(m.matches.end(), result->guided.begin(), result->guided.end());
            m.estimated = true;
            if (result->status == Status::ok) m.answer = result->answer;
          }};
}

Step simulate(const OrbOptions& orb, int views) {
  return {"views", [orb, views](const Scene& scene, Matching& m) {
            m.views = simulateViews(scene.reference_image, orb, views);
          }};
}

}  // namespace ktgp_orb::evaluation
