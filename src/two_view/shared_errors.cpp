#include "two_view/shared_errors.h"

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <algorithm>

#include "homography/transform.h"

namespace ktgp_orb {

/// `linear` was measured: the calibrated cameras of data sets with a known motion have 0.02 to
/// 0.06 px. The other values are assumptions: a calibrated focal length is good to 1 %, a
/// calibrated principal point to 1.5 px of 500, few lenses change the focal length by more than 0.3
/// % between two images, and many rolling shutters read an image for a third of the time between
/// two images. Without `principal_point`, a principal point that is 5 px off put the truth of
/// forward motions out of the 99.9 % bound in 100 of 100 drawn pairs, and that of KITTI in 41 of 50
/// pairs instead of 9 (doc/measurements/two_view.md).
SharedErrors SharedErrors::ofRealCameras() {
  SharedErrors errors;
  errors.linear = 0.05;
  errors.focal = 0.01;
  errors.zoom = 0.003;
  errors.principal_point = 0.003;
  errors.distortion = 0.3;
  errors.readout = 0.33;
  return errors;
}

bool SharedErrors::operator==(const SharedErrors& other) const {
  return linear == other.linear && focal == other.focal && zoom == other.zoom &&
         principal_point == other.principal_point && distortion == other.distortion &&
         readout == other.readout;
}

namespace two_view {
namespace {

/// Upper limit of the standard deviation of a point's movement during the readout of an image, as a
/// share of the image's rows. A faster movement would blur the image. For comparison: if a camera
/// with a focal length of 500 px and 480 rows pitches at 60 deg/s and is read out in 30 ms, the
/// points move 1.6 times as far as this limit.
constexpr double kMostRead = 0.02;

}  // namespace

SharedShifts::SharedShifts(const SharedErrors& deviations, const PointPairs& pairs,
                           const TwoViewInput& input, const std::optional<Cameras>& cameras)
    : deviations_(deviations), linear_(homography::Normalisation::of(pairs.target)) {
  if (!cameras) {
    const double linear = deviations.linear;
    deviations_ = SharedErrors();
    deviations_.linear = linear;
    return;
  }
  const auto image = [](const Eigen::Matrix3d& k, const Eigen::Matrix3d& inverse,
                        const cv::Size& size) {
    const Eigen::Vector2d whole =
        size.empty() ? 2.0 * k.topRightCorner<2, 1>() : Eigen::Vector2d(size.width, size.height);
    return Image{k, inverse, whole.y(), 0.5 * whole.norm()};
  };
  reference_ = image(cameras->reference, cameras->reference_inverse, input.reference_size);
  target_ = image(cameras->target, cameras->target_inverse, input.target_size);
}

/// Assumes that the camera moves at constant speed from the reference to the target.
SharedShifts SharedShifts::with(const Eigen::Matrix3d& rotation) const {
  SharedShifts shifts = *this;
  const Eigen::AngleAxisd turn(rotation);
  const double limit = kMostRead * target_.rows / target_.camera(0, 0);  // rad
  const double angle = std::min(deviations_.readout * turn.angle(), limit);
  const Eigen::Matrix3d velocity = crossed(angle * turn.axis());
  for (Image* image : {&shifts.reference_, &shifts.target_}) {
    image->turn = image->camera * velocity * image->inverse;
  }
  shifts.turned_ = target_.camera * rotation * reference_.inverse;
  return shifts;
}

Eigen::Vector2d SharedShifts::Image::read(const Eigen::Vector2d& point,
                                          const Eigen::Vector2d& velocity) const {
  const Eigen::Vector3d by_turn = turn * point.homogeneous();
  return fromCentre(point).y() / rows * (velocity + by_turn.head<2>() - by_turn.z() * point);
}

SharedShifts::Columns<4> SharedShifts::at(const Eigen::Vector2d& reference,
                                          const Eigen::Vector2d& target) const {
  const Eigen::RowVector3d linear =
      deviations_.linear * linear_.apply(target).homogeneous().transpose();
  Columns<4> shifts = Columns<4>::Zero();
  shifts.block<1, 3>(2, 0) = linear;
  shifts.block<1, 3>(3, 3) = linear;
  shifts.col(6) << deviations_.focal * reference_.fromCentre(reference),
      deviations_.focal * target_.fromCentre(target);
  shifts.block<2, 1>(2, 7) = deviations_.zoom * target_.fromCentre(target);
  shifts.col(8) << deviations_.principal_point * reference_.camera(0, 0), 0.0,
      deviations_.principal_point * target_.camera(0, 0), 0.0;
  shifts.col(9) << 0.0, deviations_.principal_point * reference_.camera(1, 1), 0.0,
      deviations_.principal_point * target_.camera(1, 1);
  shifts.col(10) << deviations_.distortion * reference_.distorted(reference),
      deviations_.distortion * target_.distorted(target);
  if (deviations_.readout > 0.0) {
    // The parallax is the part of the displacement that the camera's rotation does not explain.
    const Eigen::Vector2d parallax = target - (turned_ * reference.homogeneous()).hnormalized();
    const double most = kMostRead * target_.rows;
    const double share = std::min(deviations_.readout, most / std::max(parallax.norm(), 1e-9));
    const Eigen::Vector2d velocity = share * parallax;
    const Eigen::Matrix2d back = homography::jacobianByPoint(turned_, reference).inverse();
    shifts.col(11) << reference_.read(reference, back * velocity), target_.read(target, velocity);
  }
  return shifts;
}

SharedShifts::Columns<2> SharedShifts::at(const Eigen::Vector2d& reference,
                                          const Eigen::Vector2d& target,
                                          const Eigen::Matrix3d& homography) const {
  const Columns<4> shifts = at(reference, target);
  return shifts.bottomRows<2>() -
         homography::jacobianByPoint(homography, reference) * shifts.topRows<2>();
}

}  // namespace two_view
}  // namespace ktgp_orb
