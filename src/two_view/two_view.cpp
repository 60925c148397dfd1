#include "ktgp_orb/two_view.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <string>

#include "estimation/false_alarms.h"
#include "estimation/prosac.h"
#include "homography/smooth_field.h"
#include "homography/transform.h"
#include "homography/verdict.h"
#include "two_view/cameras.h"
#include "two_view/epipolar.h"
#include "two_view/hypotheses.h"
#include "two_view/motions.h"
#include "two_view/off_plane.h"
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
using two_view::EpipolarFit;
using two_view::EpipolarProblem;
using two_view::kSampsonShare;
using util::kPi;
using util::requireInRange;

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
/// Lower limit of the distances from the epipolar line, px. Without it, exact points would make any
/// model significant.
constexpr double kLeastDistance = 0.5;

void requireDeviations(const std::vector<double>& deviations, std::size_t pairs) {
  if (deviations.size() != pairs) {
    throw std::invalid_argument("deviations has " + std::to_string(deviations.size()) +
                                " numbers; expected one for each of " + std::to_string(pairs) +
                                " pairs");
  }
  for (const double each : deviations) requireInRange("a deviation", each, 1e-6, 1e6);
}

/// Reorders `values`, which must not be empty.
double medianOf(std::vector<double>& values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

/// Returns true if the two sets are mixed: if the nearest neighbour of a point of `some` is in
/// `others` more than half as often as it would be if all points were scattered at random.
bool areMixed(const std::vector<Eigen::Vector2d>& some,
              const std::vector<Eigen::Vector2d>& others) {
  constexpr double kLeastShare = 0.5;
  const auto nearest2 = [](const Eigen::Vector2d& point, const auto& points) {
    double least = std::numeric_limits<double>::infinity();
    for (const Eigen::Vector2d& other : points) {
      if (&other != &point) least = std::min(least, (other - point).squaredNorm());
    }
    return least;
  };
  std::size_t mixed = 0;
  for (const Eigen::Vector2d& point : some) {
    mixed += nearest2(point, others) < nearest2(point, some) ? 1 : 0;
  }
  const auto share =
      static_cast<double>(others.size()) / static_cast<double>(some.size() + others.size());
  return static_cast<double>(mixed) > kLeastShare * share * static_cast<double>(some.size());
}

OtherMotion turnBy(const Eigen::Matrix3d& rotation, const Covariance6& covariance) {
  return {Geometry::rotation, {rotation, Eigen::Vector3d::Zero()}, covariance};
}

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
  /// Returns log10 of the number of false alarms of the parallax. If there is parallax, the
  /// displacements of the target points from the positions that the homography predicts follow the
  /// epipolar lines more closely than random directions would. Given the homography, two pairs
  /// determine the epipole. `f`: fundamental matrix in px. Overwrites the member `chance`, which is
  /// above 1 for pairs that do not agree with `f` (see judgeEpipolar).
  double logFalseParallax(const PointPairs& pairs, const Eigen::Matrix3d& f);
  Covariance6 turnCovariance(const PointPairs& pairs) const;
  static void refuse(Doubt doubt, TwoView& result);
  static bool isMirrored(const PointPairs& pairs, const TwoView& result);
  Eigen::Matrix<double, 8, 8> planeCovariance(const PointPairs& pairs,
                                              const two_view::SharedShifts& errors) const;
  Eigen::Matrix<double, 8, 8> poorCovariance(const PointPairs& pairs,
                                             const TwoViewInput& input) const;
  void doubtRepetition(const PointPairs& pairs, const TwoViewInput& input, TwoView& result);
  double secondLayer(const PointPairs& pairs, const std::vector<double>& deviations,
                     const TwoView& result);
  double repeatedBy(const PointPairs& pairs, const std::vector<double>& deviations,
                    const TwoView& result);
  bool movesInOneRegion(const PointPairs& pairs, const TwoView& result) const;
  void doubtRigidity(const PointPairs& pairs, const TwoViewInput& input, TwoView& result);
  static void doubtTheTravel(Doubt doubt, const OtherMotion& other, TwoView& result);
  bool setMotions(const PointPairs& pairs, const TwoViewInput& input, TwoView& result);
  template <typename Moved>
  static Covariance6 spreadOf(const Covariance6& linear, const RelativePose& pose,
                              const Moved& moved);
  Covariance6 covarianceOf(const two_view::PlanarMotion& motion, const PointPairs& pairs);
  std::optional<RelativePose> refitted(const RelativePose& pose, const PointPairs& pairs,
                                       const TwoViewInput& input,
                                       const two_view::SharedShifts& shifts, int error,
                                       double amount);
  Covariance6 covarianceOf(const RelativePose& pose, const PointPairs& pairs,
                           const TwoViewInput& input);
  const two_view::PlanarMotion* planar(const RelativePose& pose) const;
  void setPlaneOrRotation(const PointPairs& pairs, const TwoViewInput& input, TwoView& result);
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
  two_view::OffPlane off_the_plane;
  std::vector<double> chance;  // probability that each pair agrees by chance; above 1: it disagrees
  std::vector<two_view::Displacement> displaced;
  std::vector<double> values;                                    // buffer for computing medians
  std::vector<Eigen::Vector2d> on_plane, off_plane, off_shifts;  // buffers of secondLayer()
  PointPairs shifted_points;                                     // buffers of refitted()
  two_view::EpipolarPairs shifted;
  two_view::EpipolarFit shifted_fit;
  double fitted_scale = 0.0;  // scale of the last fit in covarianceOf(), px
  double target_area = 0.0;
};

void TwoViewEstimator::Impl::estimate(const PointPairs& pairs, const TwoViewInput& input,
                                      TwoView& result) {
  constexpr double kMostFalseAlarms = -20.0;  // log10
  homography::requireFinite(pairs);
  if (input.deviations != nullptr) requireDeviations(*input.deviations, pairs.size());
  cameras = two_view::camerasOf(input);
  util::resetKeeping(&TwoView::mask, result);
  result.mask.assign(pairs.size(), 0);
  result.pose_covariance.setConstant(kNaN);
  result.parallax = kNaN;
  if (pairs.size() < 4) {
    result.status = Status::too_few_matches;
    return;
  }
  prosac.estimate(pairs, input.reference_size, input.homography, plane);
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
  if (has_plane && options.homography) result.homography = plane.answer.homography;
  if (log_epipolar < std::min(log_homography, kMostFalseAlarms)) {
    if (setEpipolar(pairs, input, result)) {
      if (isMirrored(pairs, result)) return refuse(Doubt::mirrored, result);
      doubtRigidity(pairs, input, result);
      return doubtRepetition(pairs, input, result);
    }
    result.status = Status::model_rejected;
    result.doubt = Doubt::undetermined;
  }
  if (!has_plane) return;
  if (!options.homography) return refuse(Doubt::undetermined, result);
  setPlaneOrRotation(pairs, input, result);
  doubtRigidity(pairs, input, result);
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
  if (const auto pose = two_view::reversedInDepth(normalised, epipolar)) hypotheses.start(*pose);
  if (input.prediction && !input.prediction->translation.isZero(0.0)) {
    hypotheses.start({input.prediction->rotation, input.prediction->translation.normalized()});
  }
  const Eigen::Matrix3d turn_alone = two_view::turnOf(normalised);
  for (const Eigen::Vector3d& direction : directions) {
    hypotheses.start({turn_alone, direction.normalized()});
  }
  for (const Epipolar& rival : problem.rivalsOf(epipolar)) hypotheses.start(rival.motion);
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
  has_plane = plane.status == Status::ok;
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
  const double parallax = logFalseParallax(pairs, f);
  log_epipolar = std::min(log_epipolar, std::min(log_plane, log_rotation) + parallax);
}

double TwoViewEstimator::Impl::logFalseParallax(const PointPairs& pairs, const Eigen::Matrix3d& f) {
  // Lens and shutter distort images by about 0.2 px, so smaller distances from the epipolar line
  // are no evidence.
  constexpr double kLeastParallax = 0.2;  // px
  const bool turned = log_rotation <= log_plane;
  const Eigen::Matrix3d h =
      turned ? cameras->homographyOf(turn.rotation()) : plane.answer.homography;
  // A pair with a smaller error under the homography is probably a right pair of a point near the
  // plane, where the parallax is small. So logParallax() uses it even if it does not agree with the
  // epipolar geometry. Wrong pairs usually have larger errors.
  constexpr double kNear = 2.0;  // in units of max_error
  // log10; added if only the pairs off the homography count. A small moving object, or matches that
  // are shifted by a period, also agree with each other. With 3 or 6, as many of 10 000 drawn
  // motions were wrong and certain as without this evidence.
  constexpr double kOfFew = 6.0;
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
  const double by_all =
      std::min(support.logFalseAlarms(chance, 2, 1.0), support.logParallax(displaced));
  // Chance explains a few points with parallax among many pairs without parallax. So the pairs far
  // off the homography are also tested alone; pairs near the homography (kNear) are left out.
  for (std::size_t i = 0; i < pairs.size(); ++i) {
    if (displaced[i].first > 0.0) chance[i] = kNaN;
  }
  return std::min(by_all, kOfFew + support.logFalseAlarms(chance, 2, 1.0));
}

/// Returns the covariance of the homography's first eight entries with the given shared errors.
Eigen::Matrix<double, 8, 8> TwoViewEstimator::Impl::planeCovariance(
    const PointPairs& pairs, const two_view::SharedShifts& errors) const {
  const two_view::SharedShifts::Columns<8> changes = two_view::sharedChanges(
      pairs, plane.mask, plane.answer.homography, errors.with(turn.rotation()));
  return plane.answer.covariance + changes * changes.transpose();
}

/// Like planeCovariance(), but with the shared errors of a poor calibration, for example a K from a
/// data sheet. Equals planeCovariance() if options.shared_errors are 0, as by default.
Eigen::Matrix<double, 8, 8> TwoViewEstimator::Impl::poorCovariance(
    const PointPairs& pairs, const TwoViewInput& input) const {
  constexpr double kPoorLinear = 10.0;  // as a multiple of options.shared_errors
  constexpr double kPoorFocal = 3.0;
  SharedErrors poor = options.shared_errors;
  poor.linear *= kPoorLinear;
  poor.focal *= kPoorFocal;
  poor.principal_point *= kPoorFocal;
  return planeCovariance(pairs, two_view::SharedShifts(poor, pairs, input, cameras));
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

/// Sets the doubt `repetitive` if many precise pairs (deviation of 1: aligned patches) do not agree
/// with the motion, or if the precise pairs off the dominant plane may be points of this plane that
/// were matched a period off (see secondLayer). If the motion is right, nearly all precise pairs
/// agree with it: 85 % or more in 340 of 351 image pairs of 21 sets. If a texture repeats itself,
/// many disagree, as in all 20 image pairs of a synthetic facade and a chessboard. The motion may
/// then be wrong by the median error of the pairs that disagree, or by the period. If hardly any
/// agree, other parts of the image repeat or mirror themselves, and there is no motion.
void TwoViewEstimator::Impl::doubtRepetition(const PointPairs& pairs, const TwoViewInput& input,
                                             TwoView& result) {
  constexpr double kLeastShare = 0.85;
  // Below this share, there is no motion. The share was at least 0.47 in 472 image pairs of 23
  // sets, even if the motion was wrong, and 0.08 for a mirrored photograph that got a motion.
  constexpr double kHardlyAny = 0.33;
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
  const double share = static_cast<double>(agree) / static_cast<double>(precise);
  const bool agrees = precise - agree < kFew || share >= kLeastShare;
  if (!agrees && share < kHardlyAny) return refuse(Doubt::repetitive, result);
  const double off = agrees ? secondLayer(pairs, *input.deviations, result)
                            : repeatedBy(pairs, *input.deviations, result);
  if (agrees && off == 0.0) return;
  result.doubt = Doubt::repetitive;
  const double turn_off = std::min(off / cameras->target(0, 0), kOpenTurn);
  const double parallax = result.parallax * kPi / 180.0;
  const double across = std::min(kOpenAcross, turn_off / std::max(parallax, 1e-6));
  const Eigen::Vector3d& t = result.pose.translation;
  result.pose_covariance.topLeftCorner<3, 3>() +=
      across * across * (Eigen::Matrix3d::Identity() - t * t.transpose());
  result.pose_covariance.bottomRightCorner<3, 3>().diagonal().array() += turn_off * turn_off;
}

/// Returns the length of the shift, px, by which the precise pairs off the dominant plane differ
/// from it, if most have nearly the same shift and they lie among the pairs on the plane; else 0. A
/// surface at another depth shifts its pairs alike, too, but it hides the plane behind it. So the
/// pairs may be on the plane, a period off, although both layers together agree with a motion.
double TwoViewEstimator::Impl::secondLayer(const PointPairs& pairs,
                                           const std::vector<double>& deviations,
                                           const TwoView& result) {
  constexpr std::size_t kFew = 8;  // minimum number of pairs off the plane
  // Largest median difference from the median shift, as a share of this shift. It is below 0.02 if
  // the pairs are a period off, and rarely below 0.15 if they have different depths; a plane that
  // is seen at an angle changes the period by more than the noise does.
  constexpr double kSame = 0.1;
  if (!has_plane || result.geometry != Geometry::epipolar) return 0.0;
  for (std::vector<Eigen::Vector2d>* buffer : {&on_plane, &off_plane, &off_shifts}) buffer->clear();
  for (std::size_t i = 0; i < pairs.size(); ++i) {
    if (deviations[i] > 1.0 || result.mask[i] == 0) continue;
    const Eigen::Vector2d& x = pairs.reference[i];
    const Eigen::Vector2d shift =
        pairs.target[i] - (plane.answer.homography * x.homogeneous()).hnormalized();
    const bool is_off = shift.norm() > options.max_error;
    (is_off ? off_plane : on_plane).push_back(x);
    if (is_off) off_shifts.push_back(shift);
  }
  if (off_shifts.size() < kFew) return 0.0;
  const auto median = [&](const auto& of) {
    values.clear();
    for (const Eigen::Vector2d& shift : off_shifts) values.push_back(of(shift));
    return medianOf(values);
  };
  const double x = median([](const Eigen::Vector2d& shift) { return shift.x(); });
  const Eigen::Vector2d middle(x, median([](const Eigen::Vector2d& shift) { return shift.y(); }));
  const double differ =
      median([&](const Eigen::Vector2d& shift) { return (shift - middle).norm(); });
  return differ < kSame * middle.norm() && areMixed(off_plane, on_plane) ? middle.norm() : 0.0;
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
  return medianOf(values);
}

/// Sets the doubt `moving_region` if the pairs off the dominant plane move differently.
void TwoViewEstimator::Impl::doubtRigidity(const PointPairs& pairs, const TwoViewInput& input,
                                           TwoView& result) {
  if (!cameras || !has_plane || result.pose.translation.isZero(0.0)) return;
  if (result.doubt == Doubt::moving_region) return;
  const auto other = off_the_plane.contradicting(
      result.pose, pairs, plane.mask, input.deviations, *cameras, shared,
      kSampsonShare * options.max_error, cellOf(pairs, input) / normalised.scale(),
      0.5 * diagonalOf(input));
  if (other) doubtTheTravel(Doubt::moving_region, *other, result);
}

/// Reports `other` as the other possible motion, and gives both motions the probability 0.5.
/// Enlarges the covariance so that any direction of the translation is possible.
void TwoViewEstimator::Impl::doubtTheTravel(Doubt doubt, const OtherMotion& other,
                                            TwoView& result) {
  constexpr double kEven = 0.5;
  result.doubt = doubt;
  result.probability = kEven;
  result.other = other;
  result.other->probability = kEven;
  const Eigen::AngleAxisd turned(other.pose.rotation * result.pose.rotation.transpose());
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
/// its square. A scene that is flat or shallow has no such scatter: there the homography limits the
/// mean parallax. Over ground, the parallax changes across the image, which looks like a turn about
/// the optical axis (see shearOf()).
Covariance6 TwoViewEstimator::Impl::turnCovariance(const PointPairs& pairs) const {
  constexpr double kMeanOfScale = 3.0;
  double unseen = std::sqrt(0.5) * kMeanOfScale * turn.scale();
  const auto sideways = two_view::sidewaysOf(
      plane.answer.homography, planeCovariance(pairs, shared), *cameras, turn.rotation());
  if (sideways) unseen = std::max(unseen, *sideways * cameras->target(0, 0));
  Covariance6 covariance = Covariance6::Zero();
  covariance.bottomRightCorner<3, 3>() = turn.covariance(shared.with(turn.rotation()), unseen);
  const double roll = two_view::shearOf(plane.answer.homography, *cameras, turn.rotation());
  covariance(5, 5) += roll * roll;
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

/// Returns the mean square of the change of a motion by one shared error. `linear`: its value to
/// first order. `moved(amount)`: the motion if the error is `amount` standard deviations; empty if
/// there is none.
template <typename Moved>
Covariance6 TwoViewEstimator::Impl::spreadOf(const Covariance6& linear, const RelativePose& pose,
                                             const Moved& moved) {
  // rad. If the error moves the direction of the translation by more than this, the first order is
  // not enough: with little parallax, the path of the translation is curved, and its length may
  // differ by a factor of three between the two signs of the error. It may also flatten out: of
  // 10 000 drawn pairs with little parallax, 48 and 30 were wrong and certain with 0.05 and 0.01.
  constexpr double kLinear = 0.01;
  if (!(linear.topLeftCorner<3, 3>().trace() > kLinear * kLinear)) return linear;
  // Nodes and weights of the quadrature of Gauss and Hermite with three nodes; the change at the
  // middle node is zero.
  constexpr double kNode = 1.7320508075688772;
  constexpr double kWeight = 1.0 / 6.0;
  Covariance6 sum = Covariance6::Zero();
  for (const double amount : {-kNode, kNode}) {
    const std::optional<RelativePose> at = moved(amount);
    if (!at) return linear;
    const Eigen::Matrix<double, 6, 1> step = two_view::stepBetween(pose, *at);
    sum += kWeight * step * step.transpose();
  }
  return sum;
}

/// Returns the covariance of a motion that the homography of the plane allows.
Covariance6 TwoViewEstimator::Impl::covarianceOf(const two_view::PlanarMotion& motion,
                                                 const PointPairs& pairs) {
  const Eigen::Matrix3d& h = plane.answer.homography;
  const RelativePose pose = motion.pose();
  const two_view::SharedShifts::Columns<8> changes =
      two_view::sharedChanges(pairs, plane.mask, h, shared.with(pose.rotation));
  Covariance6 sum = two_view::covarianceOf(motion, *cameras, plane.answer.covariance);
  for (int error = 0; error < two_view::SharedShifts::kErrors; ++error) {
    const Eigen::Matrix<double, 8, 1> change = changes.col(error);
    const auto moved = [&](double amount) -> std::optional<RelativePose> {
      const Eigen::Matrix3d at = two_view::changed(h, amount * change);
      std::optional<RelativePose> nearest;
      for (const auto& each : two_view::planarMotions(pairs, plane.mask, *cameras, at)) {
        if (!nearest || two_view::apart(each.pose(), pose) < two_view::apart(*nearest, pose)) {
          nearest = each.pose();
        }
      }
      return nearest;
    };
    sum += spreadOf(two_view::covarianceOf(motion, *cameras, change * change.transpose()), pose,
                    moved);
  }
  return sum;
}

/// Returns the motion that the fit finds, starting from `pose`, if a shared error is `amount`
/// standard deviations; empty if the pairs do not determine it.
std::optional<RelativePose> TwoViewEstimator::Impl::refitted(const RelativePose& pose,
                                                             const PointPairs& pairs,
                                                             const TwoViewInput& input,
                                                             const two_view::SharedShifts& shifts,
                                                             int error, double amount) {
  shifted_points = pairs;
  for (std::size_t i = 0; i < pairs.size(); ++i) {
    const Eigen::Vector4d shift =
        amount * shifts.at(pairs.reference[i], pairs.target[i]).col(error);
    shifted_points.reference[i] += shift.head<2>();
    shifted_points.target[i] += shift.tail<2>();
  }
  shifted.load(shifted_points, order, kSampsonShare * options.max_error, cameras, input.deviations);
  shifted_fit.setPairs(shifted);
  Epipolar geometry = shifted.fromMotion(pose);
  if (!shifted_fit.minimise(geometry)) return std::nullopt;
  return geometry.motion;
}

/// Returns the covariance of `pose`; NaN if the pairs do not determine it.
Covariance6 TwoViewEstimator::Impl::covarianceOf(const RelativePose& pose, const PointPairs& pairs,
                                                 const TwoViewInput& input) {
  // rad; if the standard deviation of the rotation (kMostTurn) or of the direction of the
  // translation (kMostAcross) is not below this, the covariance is NaN.
  constexpr double kMostTurn = 0.1;
  constexpr double kMostAcross = 0.7;
  if (const two_view::PlanarMotion* motion = planar(pose)) return covarianceOf(*motion, pairs);
  Covariance6 none = Covariance6::Constant(kNaN);
  Epipolar geometry = normalised.fromMotion(pose);
  if (!fit.minimise(geometry)) return none;
  const double cell = cellOf(pairs, input);
  const two_view::SharedShifts shifts = shared.with(geometry.motion.rotation);
  const EpipolarFit::SharedSteps steps = fit.sharedSteps(geometry, shifts);
  const estimation::Information by_noise = fit.covariance(geometry, cell);
  const estimation::Information linear = by_noise + steps * steps.transpose();
  if (!linear.allFinite() || !(linear.topLeftCorner<3, 3>().trace() < kMostTurn * kMostTurn) ||
      !(linear.bottomRightCorner<2, 2>().trace() < kMostAcross * kMostAcross)) {
    return none;
  }
  Covariance6 own = two_view::poseCovariance(by_noise, pose.translation);
  for (int error = 0; error < two_view::SharedShifts::kErrors; ++error) {
    own += spreadOf(
        two_view::poseCovariance(steps.col(error) * steps.col(error).transpose(), pose.translation),
        pose, [&](double amount) { return refitted(pose, pairs, input, shifts, error, amount); });
  }
  fitted_scale = fit.scale() / normalised.scale();
  return std::max(fit.instability(geometry, cell, own), 1.0) * own;
}

/// Sets `result` to the likeliest motion, and `result.other` to the next likeliest motion that has
/// a probability above kExcluded and clearly differs (kApart). The covariance covers all motions
/// with a probability above kExcluded. Returns false if the pairs do not determine the likeliest
/// motion.
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
  const Eigen::Matrix<double, 6, 6> inverse = util::pseudoInverseOf(own);
  Covariance6 across_best = Covariance6::Identity();
  across_best.topLeftCorner<3, 3>() -= best.translation * best.translation.transpose();
  for (std::size_t i = 1; i < list.size(); ++i) {
    const double probability = list[i].probability;
    const RelativePose& pose = list[i].geometry.motion;
    const Eigen::Matrix<double, 6, 1> step = two_view::stepBetween(best, pose);
    if (!(probability > kExcluded)) continue;
    result.pose_covariance += std::max(probability, kLeast) * step * step.transpose();
    if (step.dot(inverse * step) < kApart) continue;
    const Covariance6 its = covarianceOf(pose, pairs, input);
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

/// Reports a pure rotation if noise and the errors of a poor calibration explain the difference
/// between the homography and the homography of the fitted rotation (`turn`). The translation that
/// the homography implies is then ignored. If the errors explain the difference from any other
/// rotation, the motion over the plane is in doubt: after a wide turn, a wrong focal length changes
/// the fitted rotation too, by more than the noise does.
void TwoViewEstimator::Impl::setPlaneOrRotation(const PointPairs& pairs, const TwoViewInput& input,
                                                TwoView& result) {
  // Twice the 99.9 % quantile of chi² with five degrees of freedom. The factor of two is needed
  // because the shared errors are linearised: if the focal length is wrong by 3 %, for example,
  // hundredths of a pixel remain unexplained.
  constexpr double kBound = 2.0 * 20.515;
  if (log_rotation <= log_plane) return setRotation(pairs, result);
  if (!cameras) return setPlane(pairs, input, result);
  const Eigen::Matrix3d& h = plane.answer.homography;
  const Eigen::Matrix<double, 8, 8> covariance = poorCovariance(pairs, input);
  const Eigen::Matrix<double, 8, 1> difference =
      util::entriesOf(h) - util::entriesOf(cameras->homographyOf(turn.rotation()));
  if (std::isfinite(log_rotation) &&
      difference.dot(util::inverseOf(covariance) * difference) < kBound) {
    return setRotation(pairs, result);
  }
  setPlane(pairs, input, result);
  if (!two_view::hasPose(result) || result.doubt != Doubt::none) return;
  const auto nearest = two_view::nearestTurn(h, covariance, *cameras, turn.rotation());
  if (!nearest || !(nearest->distance2 < kBound)) return;
  // The turn allows for a translation as long as the translation that the homography implies.
  const double length = planes.front().translation.norm();
  Covariance6 of_turn = Covariance6::Zero();
  of_turn.topLeftCorner<3, 3>().diagonal().setConstant(length * length);
  of_turn.bottomRightCorner<3, 3>() = nearest->covariance;
  doubtTheTravel(Doubt::other_motion, turnBy(nearest->rotation, of_turn), result);
}

void TwoViewEstimator::Impl::setRotation(const PointPairs& pairs, TwoView& result) {
  result.status = Status::ok;
  result.geometry = Geometry::rotation;
  result.homography = cameras->homographyOf(turn.rotation());
  homography::scaleLastToOne(result.homography);
  two_view::label(pairs, cameras, options.max_error, result);
  result.pose.rotation = turn.rotation();
  result.pose_covariance = turnCovariance(pairs);
  result.probability = 1.0;
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
  result.homography.setZero();
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
    if (!fit.covariance(epipolar, cellOf(pairs, input)).allFinite()) return false;
    result.fundamental = normalised.inPixels(epipolar);
    result.scale = fit.scale() / normalised.scale();
    result.geometry = Geometry::epipolar;
  }
  result.status = Status::ok;
  two_view::label(pairs, cameras, options.max_error, result);
  if (!cameras) return true;
  result.parallax = two_view::parallaxOf(pairs, *cameras, result, values);
  // rad; the pairs do not determine a direction whose standard deviation is larger. Motions that
  // are nearly as likely enlarge it, even if none of them clearly differs.
  constexpr double kUnknown = 0.5;
  const double across2 = result.pose_covariance.topLeftCorner<3, 3>().trace();
  if (result.other || across2 > kUnknown * kUnknown) result.doubt = doubtOf(result);
  if (movesInOneRegion(pairs, result)) {
    doubtTheTravel(Doubt::moving_region, turnBy(turn.rotation(), turnCovariance(pairs)), result);
  }
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
  requireInRange("two-view shared_errors.principal_point", shared.principal_point, 0.0, 1.0);
  requireInRange("two-view shared_errors.distortion", shared.distortion, 0.0, 1e3);
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
