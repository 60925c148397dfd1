#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <opencv2/core.hpp>
#include <optional>
#include <vector>

#include "ktgp_orb/correspondence.h"
#include "ktgp_orb/features.h"
#include "ktgp_orb/orb_extractor.h"
#include "ktgp_orb/prosac_homography.h"

namespace ktgp_orb {

/// Options of the search that grows a homography from single matches.
struct GrowthOptions {
  bool enabled = false;  ///< whether the matcher grows homographies; not in the paper
  int seeds = 30;        ///< maximum number of matches to start from, 1..10000
  /// Views of a fixed reference that are searched, including the image itself, 0..13. From 5 on,
  /// four views with a tilt of 2 are added, from 13 on eight with a tilt of 4. SequenceMatcher
  /// creates them; HomographyGrowth uses those that it is given.
  int views = 0;
};

/// The reference rendered from another viewpoint (Morel & Yu, ASIFT, SIAM J. Imaging Sci. 2009).
struct ReferenceView {
  Features features;                    ///< in px of the view
  Eigen::Matrix<double, 2, 3> to_view;  /// px of the reference image to px of the view
};

/// Created once for a reference that many images are matched to.
using ReferenceViews = std::vector<ReferenceView>;

/// The simulated views (GrowthOptions::views) without the image itself: 0, 4 or 12. `image`: 8-bit
/// grey; one with more than 6.25 megapixels is shown smaller. A smaller view has proportionally
/// fewer features.
ReferenceViews simulateViews(const cv::Mat& image, const OrbOptions& options, int views);

/// Result of the search. Reused from call to call for its buffers.
struct GrowthResult {
  bool found = false;
  UncertainHomography answer;  ///< zero unless found
  /// The matches of the homography, mutual nearest within 4 px; empty unless found.
  PointPairs pairs;
  /// The matches whose keypoint belongs to the reference itself, not to a simulated view, in
  /// target order, with Level::guided.
  std::vector<Correspondence> matches;
  std::size_t support = 0;        ///< pairs of the last judged homography, at most one in 6x6 px
  double by_chance = 0.0;         ///< how many of these chance would give, according to the decoys
  double log_false_alarms = 0.0;  ///< log10 of the expected number of false alarms
  int seeds = 0;                  ///< seeds tried
  int judged = 0;                 ///< seeds that grew far enough to be judged

  /// Resets to the state before any search; keeps the buffers.
  void clear();
};

/// A homography to be judged beside those that grow.
struct GrowthStart {
  Eigen::Matrix3d homography = Eigen::Matrix3d::Identity();  ///< reference to target, px
  Eigen::Vector2d centre = Eigen::Vector2d::Zero();  ///< centre of its matches in the reference, px
};

/// Finds a homography that few matches agree with. PROSAC draws samples of four matches; when one
/// match in a hundred is right, it cannot draw four right ones. But a keypoint has a direction and
/// a size, so a single match predicts the positions of its neighbours:
/// 1. Votes: a match gets votes from matches with similar turn and scale at the predicted
///   positions.
/// 2. Seeds: the matches with most votes, best first.
/// 3. Growth: an affine map from the seed and its voters; guided matching around it; the map is
///   fitted again and the region grows, ten times. From twelve matches on, the map is a homography.
/// 4. Verdict: the homography shifted by 20 and 45 px in 24 directions each shows how many matches
///   chance gives with these images, descriptors and region. The a-contrario bound takes account of
///   the number of seeds and of possible maps (see src/growth/verdict.h). The homography must
///   also show the whole reference as a plane from one side.
///
/// An instance belongs to one thread at a time; several instances may work in parallel.
class HomographyGrowth {
 public:
  /// Throws std::invalid_argument naming the option and its range.
  explicit HomographyGrowth(const GrowthOptions& options = {});
  ~HomographyGrowth();
  HomographyGrowth(HomographyGrowth&&) noexcept;
  HomographyGrowth& operator=(HomographyGrowth&&) noexcept;

  const GrowthOptions& options() const;

  /// `matches`: matches of the two frames; only mutual ones count (KnnMatcher::matchMutual).
  /// `views`: of the reference, or null. `start`: competes with what grows from the seeds.
  void find(const Features& reference, const ReferenceViews* views, const Features& target,
            const std::vector<Correspondence>& matches, const std::optional<GrowthStart>& start,
            GrowthResult& result);
  void find(const Features& reference, const ReferenceViews* views, const Features& target,
            const std::vector<Correspondence>& matches, GrowthResult& result) {
    find(reference, views, target, matches, std::nullopt, result);
  }

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace ktgp_orb
