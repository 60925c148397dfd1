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

/// Options of HomographyGrowth, which grows a homography from single matches.
struct GrowthOptions {
  bool enabled = false;  ///< if true, the matcher grows homographies; not in the paper
  int seeds = 30;        ///< maximum number of matches to start from, 1..10000
  /// Number of views of a fixed reference in which growth searches, 0..13: the image itself and
  /// simulated views. From 5 on, there are four simulated views with a tilt of 2; from 13 on, there
  /// are eight more with a tilt of 4. A view with a tilt of t shows the image compressed to 1/t in
  /// one direction. SequenceMatcher creates the views; HomographyGrowth uses the views that the
  /// caller gives it.
  int views = 0;
};

/// The reference rendered from another viewpoint (Morel & Yu, ASIFT, SIAM J. Imaging Sci. 2009).
struct ReferenceView {
  Features features;                    ///< features of the view, in px of the view
  Eigen::Matrix<double, 2, 3> to_view;  ///< maps px of the reference image to px of the view
};

/// Simulated views of a reference. They are created once, because many images are matched to one
/// reference.
using ReferenceViews = std::vector<ReferenceView>;

/// Returns the simulated views for GrowthOptions::views = `views`, without the image itself: 0, 4
/// or 12 views. `image`: 8-bit grey; if it has more than 6.25 megapixels, it is shrunk to this size
/// first. A view with a tilt of t gets at most 1/t of OrbOptions::max_features.
ReferenceViews simulateViews(const cv::Mat& image, const OrbOptions& options, int views);

/// Result of HomographyGrowth::find. If you reuse it for the next call, it keeps its buffers.
struct GrowthResult {
  bool found = false;
  /// True if nothing was found because the scene repeats itself: the most significant homographies
  /// are not explained by chance, but another place could be right instead.
  bool is_repetitive = false;
  UncertainHomography answer;  ///< zero unless found
  /// The matches that support the homography: mutual nearest neighbours within 4 px of the
  /// predicted positions. Empty unless found.
  PointPairs pairs;
  /// The supporting matches whose reference keypoint belongs to the reference image itself, not to
  /// a simulated view. They are in target order and have Level::guided.
  std::vector<Correspondence> matches;
  /// Number of pairs that support the answer or, without one, the most significant homography. At
  /// most one pair in each square of 12x12 px counts.
  std::size_t support = 0;
  /// Number of supporting pairs expected by chance, measured with decoys (see HomographyGrowth).
  double by_chance = 0.0;
  /// log10 of the expected number of false alarms. If the answer has a shifted copy with nearly as
  /// many matches, which other evidence has refused, it is the number by chance alone.
  double log_false_alarms = 0.0;
  int seeds = 0;   ///< number of seeds tried
  int judged = 0;  ///< number of homographies that grew far enough to be judged

  /// Resets the result to the state before any search, but keeps the buffers.
  void clear();
};

/// A homography that the caller gives. It is judged like the homographies that grow from seeds.
struct GrowthStart {
  Eigen::Matrix3d homography = Eigen::Matrix3d::Identity();  ///< reference to target, px
  /// Centre of the matches that agree with the homography, px of the reference.
  Eigen::Vector2d centre = Eigen::Vector2d::Zero();
};

/// Finds a homography that only few matches agree with. PROSAC draws samples of four matches; if
/// one match in a hundred is right, it hardly ever draws four right matches. But a keypoint has a
/// direction and a size, so a single match predicts the positions of its neighbours:
/// 1. Votes: a match gets a vote from each neighbour that lies where the match predicts it, with a
///    similar rotation and scale.
/// 2. Seeds: the matches with the most votes are tried first.
/// 3. Growth: the seed and its voters give an affine map. Guided matching around the seed finds
///    more matches, the map is fitted again, and the region grows; this is repeated ten times. From
///    twelve matches on, a homography is fitted instead of an affine map.
/// 4. Verdict: decoys (the homography shifted by 20 and 45 px in 24 directions each) show how many
///    matches arise by chance with these images and descriptors in this region. The bound on the
///    number of false alarms takes into account how many seeds were tried and how many different
///    maps are possible (see src/growth/verdict.h). The homography must also pass the test that
///    PROSAC's homographies must pass (see ProsacHomography).
///
/// An instance belongs to one thread at a time; several instances may work in parallel.
class HomographyGrowth {
 public:
  /// Throws std::invalid_argument, naming the option and its range, if an option is out of range.
  explicit HomographyGrowth(const GrowthOptions& options = {});
  ~HomographyGrowth();
  HomographyGrowth(HomographyGrowth&&) noexcept;
  HomographyGrowth& operator=(HomographyGrowth&&) noexcept;

  const GrowthOptions& options() const;

  /// `matches`: matches of the two frames; only mutual matches are used (KnnMatcher::matchMutual).
  /// `views`: simulated views of the reference, or null. `start`: a homography that competes with
  /// the homographies that grow from the seeds.
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
