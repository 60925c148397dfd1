#include "ktgp_orb/two_view.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "estimation/false_alarms.h"
#include "estimation/prosac.h"
#include "homography/smooth_field.h"
#include "homography/transform.h"
#include "homography/verdict.h"
#include "two_view/cameras.h"
#include "two_view/epipolar.h"
#include "two_view/hypotheses.h"
#include "two_view/motions.h"
#include "two_view/shared_errors.h"
#include "two_view/support.h"
#include "util/constants.h"
#include "util/geometry.h"
#include "util/names.h"
#include "util/options_check.h"
#include "util/reset_keeping.h"
#include "util/small_matrix.h"

namespace ktgp_orb {
namespace {

using two_view::Epipolar;
using two_view::EpipolarProblem;
using two_view::kSampsonShare;
using util::kPi;
using util::requireInRange;

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

}  // namespace

const char* toString(Geometry geometry) {
  return util::nameOf<Geometry::epipolar>(geometry, {"none", "plane", "rotation", "epipolar"});
}

const char* toString(Doubt doubt) {
  return util::nameOf<Doubt::undetermined>(
      doubt, {"none", "two_motions_of_a_plane", "few_points_off_the_plane", "small_parallax",
              "repetitive", "moving_region", "mirrored", "other_motion", "undetermined"});
}

struct TwoViewEstimator::Impl {
  explicit Impl(const TwoViewOptions& given)
      : options(given),
        prosac({given.max_error, std::min(given.max_iterations, kPlaneSamples), given.confidence,
                given.seed}) {}

  static constexpr int kPlaneSamples = 250;  // a plane that needs more samples is not reported

  void estimate(const PointPairs& pairs, const TwoViewInput& input, TwoView& result);
  bool findEpipolar(const PointPairs& pairs, const TwoViewInput& input, TwoView& result);
  void startElsewhere(const PointPairs& pairs, const TwoViewInput& input);
  double diagonalOf(const TwoViewInput& input) const;
  double cellOf(const PointPairs& pairs, const TwoViewInput& input) const;
  void judgeHomography(const PointPairs& pairs, const TwoViewInput& input);
  void judgeEpipolar(const PointPairs& pairs, const TwoViewInput& input);
  Covariance6 turnCovariance() const;
  static void refuse(Doubt doubt, TwoView& result);
  static bool isMirrored(const PointPairs& pairs, const TwoView& result);
  bool isTurn(const PointPairs& pairs, const TwoViewInput& input) const;
  void doubtRepetition(const PointPairs& pairs, const TwoViewInput& input, TwoView& result);
  double repeatedBy(const PointPairs& pairs, const std::vector<double>& deviations,
                    const TwoView& result);
  bool movesInOneRegion(const PointPairs& pairs, const TwoView& result) const;
  void doubtTheTravel(TwoView& result) const;
  bool setMotions(const PointPairs& pairs, const TwoViewInput& input, TwoView& result);
  Covariance6 covarianceOf(const RelativePose& pose, const PointPairs& pairs,
                           const TwoViewInput& input);
  const two_view::PlanarMotion* planar(const RelativePose& pose) const;
  void setPlane(const PointPairs& pairs, const TwoViewInput& input, TwoView& result);
  void setRotation(const PointPairs& pairs, TwoView& result);
  Doubt doubtOf(const TwoView& result) const;
  bool setEpipolar(const PointPairs& pairs, const TwoViewInput& input, TwoView& result);

  TwoViewOptions options;
  ProsacHomography prosac;
  ProsacResult plane;
  bool has_plane = false;
  double log_plane = 0.0;     // log10 of the homography's number of false alarms
  double log_rotation = 0.0;  // log10 of the rotation's number of false alarms
  double log_epipolar = 0.0;
  two_view::RotationFit turn;
  std::optional<two_view::Cameras> cameras;
  two_view::SharedShifts shared;
  estimation::QualityOrder order;
  two_view::EpipolarPairs normalised;
  EpipolarProblem problem;
  estimation::ProsacSearch<EpipolarProblem> search;
  two_view::EpipolarFit fit;  // fit of the reported geometry
  two_view::Hypotheses hypotheses;
  std::vector<two_view::PlanarMotion> planes;  // motions that the homography of the plane allows
  Epipolar epipolar;
  two_view::Support support;
  std::vector<double> chance;  // probability that each pair agrees by chance; above 1: it disagrees
  std::vector<two_view::Displacement> displaced;
  std::vector<double> values;  // buffer for computing medians
  double fitted_scale = 0.0;   // scale of the last fit in covarianceOf(), px
  double target_area = 0.0;
};

void TwoViewEstimator::Impl::estimate(const PointPairs& pairs, const TwoViewInput& input,
                                      TwoView& result) {
  constexpr double kMostFalseAlarms = -20.0;  // log10
  homography::requireFinite(pairs);
  cameras = two_view::camerasOf(input);
  util::resetKeeping(&TwoView::mask, result);
  result.mask.assign(pairs.size(), 0);
  result.pose_covariance.setConstant(kNaN);
  result.parallax = kNaN;
  if (pairs.size() < 4) {
    result.status = Status::too_few_matches;
    return;
  }
  plane.status = Status::no_model;
  if (options.homography) {
    prosac.estimate(pairs, input.reference_size, input.homography, plane);
  }
  target_area = estimation::coveredArea(pairs.target);
  shared = two_view::SharedShifts(options.shared_errors, pairs, input, cameras);
  support.load(pairs, options.max_error);
  judgeHomography(pairs, input);
  log_epipolar = 0.0;
  planes.clear();
  hypotheses.clear();
  if (pairs.size() > (cameras ? 5U : 7U)) {
    order.sort(pairs.quality);
    normalised.load(pairs, order, kSampsonShare * options.max_error, cameras, input.deviations);
    if (findEpipolar(pairs, input, result)) judgeEpipolar(pairs, input);
  }
  const double log_homography = std::min(log_plane, log_rotation);
  result.log_false_alarms_homography = log_homography;
  result.log_false_alarms_epipolar = log_epipolar;
  if (has_plane) result.homography = plane.answer.homography;
  if (log_epipolar < std::min(log_homography, kMostFalseAlarms)) {
    if (setEpipolar(pairs, input, result)) {
      if (isMirrored(pairs, result)) return refuse(Doubt::mirrored, result);
      return doubtRepetition(pairs, input, result);
    }
    result.status = Status::model_rejected;
    result.doubt = Doubt::undetermined;
  }
  if (!has_plane) return;
  result.probability = 1.0;
  if (log_rotation <= log_plane || isTurn(pairs, input)) {
    setRotation(pairs, result);
  } else {
    setPlane(pairs, input, result);
  }
  doubtRepetition(pairs, input, result);
}

bool TwoViewEstimator::Impl::findEpipolar(const PointPairs& pairs, const TwoViewInput& input,
                                          TwoView& result) {
  estimation::ProsacRules rules{options.max_iterations, options.confidence};
  // Chance that a random target point is an inlier. The strip within the limit on both sides of an
  // epipolar line covers this share of a square with the same area as the target points.
  const double width = 2.0 * std::sqrt(2.0) * kSampsonShare * options.max_error;
  rules.chance_inlier = std::clamp(width / std::sqrt(std::max(target_area, 1.0)), 0.2, 0.5);
  // Without a minimum, sampling could stop too early: with little parallax, wrong motions agree
  // with most pairs, and even with all of the best pairs. With K, a small minimum is enough,
  // because the fit also starts from other motions (see startElsewhere). Without K, it must be
  // larger, because a sample on one plane may give a geometry that agrees only with that plane.
  rules.min_iterations = cameras ? 40 : 200;
  rules.seed = options.seed;
  std::optional<Epipolar> initial;
  if (cameras && input.prediction && input.prediction->translation.norm() > 0.5) {
    initial = normalised.fromMotion(*input.prediction);
  }
  problem.setPairs(normalised);
  const bool found = search.run(rules, initial, problem);
  result.iterations = search.iterations();
  if (!found) return false;
  epipolar = search.best();
  fit.setPairs(normalised);
  if (cameras) {
    startElsewhere(pairs, input);
    if (hypotheses.list().empty()) return false;
    epipolar = hypotheses.list().front().geometry;
  }
  return fit.minimise(epipolar);
}

/// Adds other motions from which the fit starts. With little parallax, a wrong direction of the
/// translation agrees with most pairs if the rotation makes up for it. Sampling may stop at such a
/// motion, and the fit cannot leave it. On a plane, the second motion that the homography allows
/// also agrees.
void TwoViewEstimator::Impl::startElsewhere(const PointPairs& pairs, const TwoViewInput& input) {
  static const Eigen::Vector3d directions[] = {{0, 0, 1},  {1, 0, 0}, {0, 1, 0}, {1, 0, 1},
                                               {-1, 0, 1}, {0, 1, 1}, {0, -1, 1}};
  hypotheses.load(normalised, cellOf(pairs, input), 0.5 * diagonalOf(input) * normalised.scale(),
                  epipolar, has_plane ? &plane.answer.homography : nullptr);
  hypotheses.start(epipolar.motion);
  if (input.prediction && !input.prediction->translation.isZero(0.0)) {
    hypotheses.start({input.prediction->rotation, input.prediction->translation.normalized()});
  }
  const Eigen::Matrix3d turn_alone = two_view::turnOf(normalised);
  for (const Eigen::Vector3d& direction : directions) {
    hypotheses.start({turn_alone, direction.normalized()});
  }
  if (has_plane) {
    for (const two_view::PlanarMotion& motion :
         two_view::planarMotions(pairs, plane.mask, *cameras, plane.answer.homography)) {
      hypotheses.start(motion.pose());
    }
  }
  hypotheses.refine();
}

double TwoViewEstimator::Impl::diagonalOf(const TwoViewInput& input) const {
  return input.target_size.empty() ? std::sqrt(2.0 * target_area)
                                   : std::hypot(input.target_size.width, input.target_size.height);
}

/// Returns the side of a cell of the reference image, normalised units. Pairs in the same cell may
/// have correlated errors.
double TwoViewEstimator::Impl::cellOf(const PointPairs& pairs, const TwoViewInput& input) const {
  const auto corners = homography::imageCorners(input.reference_size, pairs.reference);
  return (corners[2] - corners[0]).norm() * normalised.scale() / homography::kCellsAlongDiagonal;
}

/// Sets log_plane, and also log_rotation if K is known and a rotation explains the pairs.
void TwoViewEstimator::Impl::judgeHomography(const PointPairs& pairs, const TwoViewInput& input) {
  has_plane = options.homography && plane.status == Status::ok;
  log_plane = 0.0;
  log_rotation = std::numeric_limits<double>::infinity();  // until a rotation is found
  if (!has_plane) return;
  const auto judge = [&](const Eigen::Matrix3d& h, std::size_t sample) {
    chance.assign(pairs.size(), 2.0);
    for (std::size_t i = 0; i < pairs.size(); ++i) {
      const double error = homography::errorOf(h, pairs.reference[i], pairs.target[i]);
      if (!(error < options.max_error)) continue;
      chance[i] = kPi * std::max(error * error, 1.0 / kPi) / target_area;
    }
    return support.logFalseAlarms(chance, sample, 1.0);
  };
  log_plane = judge(plane.answer.homography, 4);
  if (cameras && turn.fit(pairs, *cameras, plane.answer.homography, plane.inliers,
                          options.max_error, input.deviations)) {
    log_rotation = judge(cameras->homographyOf(turn.rotation()), 2);
  }
}

void TwoViewEstimator::Impl::judgeEpipolar(const PointPairs& pairs, const TwoViewInput& input) {
  // Lower limits of the distances from the epipolar line, px. Without kLeastDistance, exact points
  // would make any model significant. kLeastParallax is needed because lens and shutter distort
  // images by about 0.2 px.
  constexpr double kLeastDistance = 0.5;
  constexpr double kLeastParallax = 0.2;
  const Eigen::Matrix3d f = normalised.inPixels(epipolar);
  const double limit = kSampsonShare * options.max_error;
  const double diagonal = diagonalOf(input);
  const std::size_t sample = cameras ? 5 : 7;
  const double models = cameras ? 10.0 : 3.0;
  chance.assign(pairs.size(), 2.0);
  for (std::size_t i = 0; i < pairs.size(); ++i) {
    if (!(two_view::sampson(f, pairs.reference[i], pairs.target[i]) < limit)) continue;
    if (cameras && !cameras->seeInFront(epipolar.motion, pairs.reference[i], pairs.target[i],
                                        options.max_error)) {
      continue;
    }
    const double distance = two_view::distanceToLine(f, pairs.reference[i], pairs.target[i]);
    chance[i] = 2.0 * std::max(distance, kLeastDistance) * diagonal / target_area;
  }
  log_epipolar = support.logFalseAlarms(chance, sample, models);
  if (!has_plane) return;
  // Evidence for parallax: the target points are displaced from the positions that the homography
  // predicts. If there is parallax, these displacements follow the epipolar lines more closely than
  // displacements with random directions would. Given the homography, two pairs determine the
  // epipole.
  const bool turned = log_rotation <= log_plane;
  const Eigen::Matrix3d h =
      turned ? cameras->homographyOf(turn.rotation()) : plane.answer.homography;
  // A pair with a smaller error under the homography is probably a right pair of a point near the
  // plane, where the parallax is small. So logParallax() uses it even if it does not agree with the
  // epipolar geometry. Wrong pairs usually have larger errors.
  constexpr double kNear = 2.0;  // in units of max_error
  displaced.assign(pairs.size(), {});
  for (std::size_t i = 0; i < pairs.size(); ++i) {
    const double error = homography::errorOf(h, pairs.reference[i], pairs.target[i]);
    const bool is_near = error < kNear * options.max_error;
    if (!is_near && chance[i] > 1.0) continue;
    const double across = two_view::distanceToLine(f, pairs.reference[i], pairs.target[i]);
    if (is_near) {
      const double least = std::max(across, kLeastDistance);
      displaced[i] = {error * error, least * least};
    }
    if (chance[i] > 1.0) continue;
    const double distance = std::max(across, kLeastParallax);
    chance[i] = distance < error ? 2.0 / kPi * std::asin(distance / error) : 1.0;
  }
  const double parallax =
      std::min(support.logFalseAlarms(chance, 2, 1.0), support.logParallax(displaced));
  log_epipolar = std::min(log_epipolar, std::min(log_plane, log_rotation) + parallax);
}

/// Returns true if noise and shared errors explain the difference between the homography and the
/// homography of the fitted rotation (`turn`). Then a pure rotation is reported, and the
/// translation that the homography implies is ignored.
bool TwoViewEstimator::Impl::isTurn(const PointPairs& pairs, const TwoViewInput& input) const {
  // Twice the 99.9 % quantile of chi² with five degrees of freedom. The factor of two is needed
  // because the shared errors are linearised: if the focal length is wrong by 3 %, for example,
  // hundredths of a pixel remain unexplained.
  constexpr double kBound = 2.0 * 20.515;
  // Errors of a poor calibration, as multiples of options.shared_errors: K may come from a data
  // sheet or from the software of a phone, for example.
  constexpr double kPoorLinear = 10.0;
  constexpr double kPoorFocal = 3.0;
  if (!cameras || !std::isfinite(log_rotation)) return false;
  const Eigen::Matrix<double, 8, 1> difference =
      util::entriesOf(plane.answer.homography) -
      util::entriesOf(cameras->homographyOf(turn.rotation()));
  SharedErrors poor = options.shared_errors;
  poor.linear *= kPoorLinear;
  poor.focal *= kPoorFocal;
  const Eigen::Matrix<double, 8, 8> covariance =
      plane.answer.covariance +
      two_view::sharedCovariance(
          pairs, plane.mask, plane.answer.homography,
          two_view::SharedShifts(poor, pairs, input, cameras).with(turn.rotation()));
  return difference.dot(util::inverseOf(covariance) * difference) < kBound;
}

/// Returns true if a rotation, or a camera at rest, explains most inliers within their errors
/// (resting pairs), and most of the other inliers (moving pairs) lie in one region. Then there may
/// be a moving object in this region instead of depth.
bool TwoViewEstimator::Impl::movesInOneRegion(const PointPairs& pairs,
                                              const TwoView& result) const {
  // Largest error of a resting pair, as a multiple of the scale of the Sampson distances. The
  // factor 1.5 is needed because these errors have two coordinates.
  constexpr double kErrors = 4.0 * 1.5;
  constexpr double kLeastScale = 0.1;  // px
  constexpr std::size_t kFew = 8;      // minimum number of moving pairs
  constexpr double kOutside = 0.1;     // share of the moving pairs outside the region on each side
  constexpr double kResting = 0.3;  // largest share of resting pairs among all pairs in the region
  constexpr double kLargest = 0.5;  // largest region, as a share of the area of all pairs
  if (!std::isfinite(log_rotation)) return false;
  const Eigen::Matrix3d h = cameras->homographyOf(turn.rotation());
  const double limit = kErrors * std::max(result.scale, kLeastScale);
  std::vector<double> x, y;
  std::vector<Eigen::Vector2d> resting;
  for (std::size_t i = 0; i < pairs.size(); ++i) {
    if (result.mask[i] == 0) continue;
    if (homography::errorOf(h, pairs.reference[i], pairs.target[i]) < limit) {
      resting.push_back(pairs.reference[i]);
    } else {
      x.push_back(pairs.reference[i].x());
      y.push_back(pairs.reference[i].y());
    }
  }
  if (x.size() < kFew || resting.size() < x.size()) return false;
  std::sort(x.begin(), x.end());
  std::sort(y.begin(), y.end());
  const auto first = static_cast<std::size_t>(kOutside * static_cast<double>(x.size()));
  const std::size_t last = x.size() - 1 - first;
  const auto inside = std::count_if(resting.begin(), resting.end(), [&](const auto& p) {
    return p.x() > x[first] && p.x() < x[last] && p.y() > y[first] && p.y() < y[last];
  });
  const double area = (x[last] - x[first]) * (y[last] - y[first]);
  const double moving = static_cast<double>(last - first + 1);
  return area < kLargest * estimation::coveredArea(pairs.reference) &&
         static_cast<double>(inside) < kResting * (moving + static_cast<double>(inside));
}

/// Sets the doubt `repetitive` if many of the most precise pairs do not agree with the motion. The
/// most precise pairs are the pairs whose patches could be aligned. If the motion is right, nearly
/// all of them agree with it: 85 % or more in 340 of 351 image pairs of 21 sets. If a texture
/// repeats itself, many disagree, as in all 20 image pairs of a synthetic facade and a chessboard.
/// The motion may then be wrong by the median error of the pairs that disagree.
void TwoViewEstimator::Impl::doubtRepetition(const PointPairs& pairs, const TwoViewInput& input,
                                             TwoView& result) {
  constexpr double kLeastShare = 0.85;
  constexpr std::size_t kFew = 8;      // minimum number of precise pairs that disagree
  constexpr double kOpenTurn = 0.2;    // rad; largest standard deviation added to the rotation
  constexpr double kOpenAcross = 1.0;  // rad; the same for the direction of the translation
  if (!cameras || input.deviations == nullptr) return;
  std::size_t precise = 0;
  std::size_t agree = 0;
  for (std::size_t i = 0; i < result.mask.size(); ++i) {
    if ((*input.deviations)[i] > 1.0) continue;
    ++precise;
    agree += result.mask[i];
  }
  if (precise - agree < kFew ||
      static_cast<double>(agree) >= kLeastShare * static_cast<double>(precise)) {
    return;
  }
  result.doubt = Doubt::repetitive;
  const double off = repeatedBy(pairs, *input.deviations, result);
  const double turn_off = std::min(off / cameras->target(0, 0), kOpenTurn);
  const double parallax = result.parallax * kPi / 180.0;
  const double across = std::min(kOpenAcross, turn_off / std::max(parallax, 1e-6));
  const Eigen::Vector3d& t = result.pose.translation;
  result.pose_covariance.topLeftCorner<3, 3>() +=
      across * across * (Eigen::Matrix3d::Identity() - t * t.transpose());
  result.pose_covariance.bottomRightCorner<3, 3>().diagonal().array() += turn_off * turn_off;
}

/// Returns the median error of the precise pairs that do not agree with the geometry, px.
double TwoViewEstimator::Impl::repeatedBy(const PointPairs& pairs,
                                          const std::vector<double>& deviations,
                                          const TwoView& result) {
  // Approximate ratio of a reprojection error to the Sampson distance. The Sampson distance splits
  // an error between both images, and does not contain the part along the epipolar line.
  constexpr double kOfSampson = 2.0;
  const bool is_epipolar = result.geometry == Geometry::epipolar;
  values.clear();
  for (std::size_t i = 0; i < pairs.size(); ++i) {
    if (deviations[i] > 1.0 || result.mask[i] != 0) continue;
    const Eigen::Vector2d& x = pairs.reference[i];
    const Eigen::Vector2d& u = pairs.target[i];
    values.push_back(is_epipolar ? kOfSampson * two_view::sampson(result.fundamental, x, u)
                                 : homography::errorOf(result.homography, x, u));
  }
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

/// Reports a pure rotation (`turn`) as the other possible motion, and gives both motions the
/// probability 0.5. Enlarges the covariance so that any direction of the translation is possible.
void TwoViewEstimator::Impl::doubtTheTravel(TwoView& result) const {
  constexpr double kEven = 0.5;
  result.doubt = Doubt::moving_region;
  result.probability = kEven;
  result.other = OtherMotion{
      Geometry::rotation, {turn.rotation(), Eigen::Vector3d::Zero()}, turnCovariance(), kEven};
  const Eigen::AngleAxisd turned(turn.rotation() * result.pose.rotation.transpose());
  const Eigen::Vector3d step = turned.angle() * turned.axis();
  const Eigen::Vector3d& t = result.pose.translation;
  result.pose_covariance.topLeftCorner<3, 3>() += Eigen::Matrix3d::Identity() - t * t.transpose();
  result.pose_covariance.bottomRightCorner<3, 3>() += kEven * step * step.transpose();
}

/// Returns the covariance of a pure rotation; the unit of the translation is the distance to the
/// scene. The residuals of the rotation may be parallax, and the mean of this parallax is not in
/// the residuals, because it looks like a rotation. If the depths of the scene vary between 3 and
/// 12, in any unit, the mean parallax is 2.2 times the scatter of the parallax, and the scale of
/// Student's t distribution, turn.scale(), is 0.8 times this scatter. So the mean parallax is about
/// three times this scale. Its direction is not known, so the variance along each axis is half of
/// its square.
Covariance6 TwoViewEstimator::Impl::turnCovariance() const {
  constexpr double kMeanOfScale = 3.0;
  const double unseen = std::sqrt(0.5) * kMeanOfScale * turn.scale();
  Covariance6 covariance = Covariance6::Zero();
  covariance.bottomRightCorner<3, 3>() = turn.covariance(shared.with(turn.rotation()), unseen);
  covariance.topLeftCorner<3, 3>().diagonal().setConstant(
      std::pow(unseen / cameras->target(0, 0), 2));
  // A zoom looks like a translation along the optical axis.
  covariance(2, 2) += std::pow(options.shared_errors.zoom, 2);
  return covariance;
}

/// Returns true if the inliers map the image to its mirror image, which no camera can do. Wrong
/// matches on a symmetric object can do so, and may still agree with a motion.
bool TwoViewEstimator::Impl::isMirrored(const PointPairs& pairs, const TwoView& result) {
  // Limit of 2 det(A) / |A|², where A is the 2x2 matrix `map` fitted to the inliers. This value is
  // 1 for a similarity and -1 for a mirrored similarity.
  constexpr double kClearly = -0.3;
  Eigen::Vector2d from = Eigen::Vector2d::Zero();
  Eigen::Vector2d to = Eigen::Vector2d::Zero();
  const auto count = static_cast<double>(result.inliers);
  for (std::size_t i = 0; i < pairs.size(); ++i) {
    if (result.mask[i] == 0) continue;
    from += pairs.reference[i] / count;
    to += pairs.target[i] / count;
  }
  Eigen::Matrix2d squares = 1e-9 * Eigen::Matrix2d::Identity();
  Eigen::Matrix2d products = Eigen::Matrix2d::Zero();
  for (std::size_t i = 0; i < pairs.size(); ++i) {
    if (result.mask[i] == 0) continue;
    const Eigen::Vector2d d = pairs.reference[i] - from;
    squares += d * d.transpose();
    products += (pairs.target[i] - to) * d.transpose();
  }
  const Eigen::Matrix2d map = products * squares.inverse();
  return 2.0 * map.determinant() < kClearly * map.squaredNorm();
}

/// Returns the motion in `planes` that equals `pose`; null if there is none.
const two_view::PlanarMotion* TwoViewEstimator::Impl::planar(const RelativePose& pose) const {
  constexpr double kSame = 1e-6;  // rad
  for (const two_view::PlanarMotion& motion : planes) {
    if (two_view::apart(motion.pose(), pose) < kSame) return &motion;
  }
  return nullptr;
}

/// Returns the covariance of `pose`; NaN if the pairs do not determine it.
Covariance6 TwoViewEstimator::Impl::covarianceOf(const RelativePose& pose, const PointPairs& pairs,
                                                 const TwoViewInput& input) {
  // rad; if the standard deviation of the rotation (kMostTurn) or of the direction of the
  // translation (kMostAcross) is not below this, the covariance is NaN.
  constexpr double kMostTurn = 0.1;
  constexpr double kMostAcross = 0.7;
  if (const two_view::PlanarMotion* motion = planar(pose)) {
    return two_view::covarianceOf(
        *motion, *cameras,
        plane.answer.covariance + two_view::sharedCovariance(pairs, plane.mask,
                                                             plane.answer.homography,
                                                             shared.with(pose.rotation)));
  }
  Epipolar geometry = normalised.fromMotion(pose);
  if (fit.minimise(geometry)) {
    const auto covariance =
        fit.covariance(geometry, cellOf(pairs, input), shared.with(geometry.motion.rotation));
    if (covariance.allFinite() &&
        covariance.topLeftCorner<3, 3>().trace() < kMostTurn * kMostTurn &&
        covariance.bottomRightCorner<2, 2>().trace() < kMostAcross * kMostAcross) {
      const Covariance6 own = two_view::poseCovariance(covariance, pose.translation);
      const double scale = fit.scale();
      const double factor = fit.instability(geometry, cellOf(pairs, input), own);
      fitted_scale = scale / normalised.scale();
      return std::max(factor, 1.0) * own;
    }
  }
  return Covariance6::Constant(kNaN);
}

/// Sets `result` to the likeliest motion, and `result.other` to the next likeliest motion that has
/// a probability above kExcluded and clearly differs (kApart). The covariance covers all such
/// motions. Returns false if the pairs do not determine the likeliest motion.
bool TwoViewEstimator::Impl::setMotions(const PointPairs& pairs, const TwoViewInput& input,
                                        TwoView& result) {
  constexpr double kExcluded = 1e-3;
  // Minimum weight of another motion in the covariance, because the probabilities are not exact.
  constexpr double kLeast = 0.2;
  // Motions count as equal if their squared distance, in standard deviations, is below this.
  constexpr double kApart = 25.0;
  const auto& list = hypotheses.list();
  const RelativePose& best = list.front().geometry.motion;
  const Covariance6 own = covarianceOf(best, pairs, input);
  if (!own.allFinite()) return false;
  result.geometry = planar(best) != nullptr ? Geometry::plane : Geometry::epipolar;
  result.scale = planar(best) != nullptr ? 0.0 : fitted_scale;
  result.pose = best;
  result.pose_covariance = own;
  result.fundamental = cameras->fundamentalOf(best).normalized();
  result.probability = 1.0;
  const Eigen::Matrix<double, 6, 6> inverse =
      Eigen::Matrix<double, 6, 6>(own).completeOrthogonalDecomposition().pseudoInverse();
  Covariance6 across_best = Covariance6::Identity();
  across_best.topLeftCorner<3, 3>() -= best.translation * best.translation.transpose();
  for (std::size_t i = 1; i < list.size(); ++i) {
    const double probability = list[i].probability;
    const RelativePose& pose = list[i].geometry.motion;
    const Eigen::Matrix<double, 6, 1> step = two_view::stepBetween(best, pose);
    if (!(probability > kExcluded) || step.dot(inverse * step) < kApart) continue;
    const Covariance6 its = covarianceOf(pose, pairs, input);
    result.pose_covariance += std::max(probability, kLeast) * step * step.transpose();
    if (its.allFinite()) result.pose_covariance += across_best * its * across_best;
    // The length of `step` is the angle between the two translations. The component of their
    // difference that is orthogonal to best.translation is only as long as the sine of this angle.
    // So we also add the difference between angle and sine.
    const double angle = step.head<3>().norm();
    const Eigen::Vector3d sideways = (1.0 - std::sin(angle) / angle) * step.head<3>();
    if (angle > 0.0) {
      result.pose_covariance.topLeftCorner<3, 3>() += sideways * sideways.transpose();
    }
    if (result.other) continue;
    result.probability = list.front().probability / (list.front().probability + probability);
    result.other = OtherMotion{planar(pose) != nullptr ? Geometry::plane : Geometry::epipolar, pose,
                               its, 1.0 - result.probability};
  }
  return true;
}

void TwoViewEstimator::Impl::setRotation(const PointPairs& pairs, TwoView& result) {
  result.status = Status::ok;
  result.geometry = Geometry::rotation;
  result.homography = cameras->homographyOf(turn.rotation());
  homography::scaleLastToOne(result.homography);
  two_view::label(pairs, cameras, options.max_error, result);
  result.pose.rotation = turn.rotation();
  result.pose_covariance = turnCovariance();
  result.parallax = 0.0;
}

void TwoViewEstimator::Impl::setPlane(const PointPairs& pairs, const TwoViewInput& input,
                                      TwoView& result) {
  result.status = Status::ok;
  result.geometry = Geometry::plane;
  result.homography = plane.answer.homography;
  two_view::label(pairs, cameras, options.max_error, result);
  if (!cameras || hypotheses.list().empty()) return;
  planes = two_view::planarMotions(pairs, result.mask, *cameras, result.homography);
  if (planes.empty()) return;
  std::vector<RelativePose> poses;
  for (const two_view::PlanarMotion& motion : planes) poses.push_back(motion.pose());
  hypotheses.prefer(poses);
  if (!setMotions(pairs, input, result)) return;
  two_view::label(pairs, cameras, options.max_error, result);
  result.parallax = two_view::parallaxOf(pairs, *cameras, result, values);
  if (result.other) result.doubt = Doubt::two_motions_of_a_plane;
}

/// Withdraws the answer, but keeps the numbers of false alarms.
void TwoViewEstimator::Impl::refuse(Doubt doubt, TwoView& result) {
  result.status = Status::model_rejected;
  result.doubt = doubt;
  result.geometry = Geometry::none;
  result.fundamental.setZero();
  result.pose = {};
  result.pose_covariance.setConstant(kNaN);
  result.parallax = kNaN;
  result.probability = result.rmse = result.scale = 0.0;
  result.other.reset();
  std::fill(result.mask.begin(), result.mask.end(), std::uint8_t(0));
  result.inliers = 0;
}

/// Returns false if the inliers do not determine the geometry.
bool TwoViewEstimator::Impl::setEpipolar(const PointPairs& pairs, const TwoViewInput& input,
                                         TwoView& result) {
  if (cameras) {
    if (!setMotions(pairs, input, result)) return false;
  } else {
    if (!fit.covariance(epipolar, cellOf(pairs, input), shared).allFinite()) return false;
    result.fundamental = normalised.inPixels(epipolar);
    result.scale = fit.scale() / normalised.scale();
    result.geometry = Geometry::epipolar;
  }
  result.status = Status::ok;
  two_view::label(pairs, cameras, options.max_error, result);
  if (!cameras) return true;
  result.parallax = two_view::parallaxOf(pairs, *cameras, result, values);
  if (result.other) result.doubt = doubtOf(result);
  if (movesInOneRegion(pairs, result)) doubtTheTravel(result);
  return true;
}

/// For a scene with depth: returns the reason why another motion is nearly as likely.
Doubt TwoViewEstimator::Impl::doubtOf(const TwoView& result) const {
  constexpr double kSmallParallax = 1.0;  // degrees; below this, ORB-SLAM does not start a map
  if (result.parallax < kSmallParallax) return Doubt::small_parallax;
  return 2 * plane.inliers > result.inliers && has_plane ? Doubt::few_points_off_the_plane
                                                         : Doubt::other_motion;
}

TwoViewEstimator::TwoViewEstimator(const TwoViewOptions& options) {
  requireInRange("two-view max_error", options.max_error, 1e-6, 1e6);
  requireInRange("two-view max_iterations", options.max_iterations, 1, 1000000);
  const SharedErrors& shared = options.shared_errors;
  requireInRange("two-view shared_errors.linear", shared.linear, 0.0, 1e3);
  requireInRange("two-view shared_errors.focal", shared.focal, 0.0, 1.0);
  requireInRange("two-view shared_errors.zoom", shared.zoom, 0.0, 1.0);
  requireInRange("two-view shared_errors.readout", shared.readout, 0.0, 1.0);
  requireInRange("two-view confidence", options.confidence, 1e-6, 1.0 - 1e-9);
  impl_ = std::make_unique<Impl>(options);
}

TwoViewEstimator::~TwoViewEstimator() = default;
TwoViewEstimator::TwoViewEstimator(TwoViewEstimator&&) noexcept = default;
TwoViewEstimator& TwoViewEstimator::operator=(TwoViewEstimator&&) noexcept = default;

const TwoViewOptions& TwoViewEstimator::options() const {
  return impl_->options;
}

void TwoViewEstimator::estimate(const PointPairs& pairs, const TwoViewInput& input,
                                TwoView& result) {
  impl_->estimate(pairs, input, result);
}

TwoView estimateTwoView(const std::vector<Eigen::Vector2d>& reference,
                        const std::vector<Eigen::Vector2d>& target, const TwoViewInput& input,
                        const TwoViewOptions& options) {
  PointPairs pairs;
  pairs.reference = reference;
  pairs.target = target;
  pairs.quality.resize(reference.size());
  for (std::size_t i = 0; i < reference.size(); ++i) pairs.quality[i] = static_cast<double>(i);
  TwoView result;
  TwoViewEstimator(options).estimate(pairs, input, result);
  return result;
}

}  // namespace ktgp_orb
