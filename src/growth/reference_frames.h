#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "growth/local_frame.h"
#include "growth/local_matcher.h"
#include "ktgp_orb/growth.h"

namespace ktgp_orb::growth {

/// The keypoints of the reference and of its simulated views, all in px of the reference. Keeps its
/// buffers.
class ReferenceFrames {
 public:
  /// `views`: may be null.
  void set(const Features& reference, const ReferenceViews* views);

  /// The keypoints within `reach` px of `centre`, mapped by `map`, reference to target. Only those
  /// of the views that look like the target around the centre: the map from the view has little
  /// tilt, so that descriptors and directions can agree. Without those more than `kMargin` px
  /// outside the target. False, without keypoints, if the map around the centre is not the view of
  /// a plane with a tilt that descriptors tolerate.
  bool predict(const Eigen::Matrix3d& map, const Eigen::Vector2d& centre, double reach,
               const cv::Size& target, std::vector<Prediction>& predictions);
  static constexpr float kMargin = 50.F;

  const std::vector<LocalFrame>& frames() const { return frames_; }
  const std::vector<Bits>& bits() const { return bits_; }
  /// px of the reference to px of the view of that keypoint, without the shift.
  const Eigen::Matrix2f& toView(std::size_t keypoint) const {
    return views_[view_of_[keypoint]].to_view;
  }

 private:
  struct View {
    std::size_t begin, end;     // range of its keypoints
    Eigen::Matrix2d from_view;  // px of the view to px of the reference, without the shift
    Eigen::Matrix2f to_view;    // inverse of from_view
  };

  void add(const Features& features, const Eigen::Matrix<double, 2, 3>& to_view);
  bool chooseViews(const Eigen::Matrix2d& jacobian);

  std::vector<View> views_;
  std::vector<double> squeeze_;  // tilt from each view
  std::vector<std::uint8_t> chosen_;
  std::vector<std::uint16_t> view_of_;  // view of each keypoint
  std::vector<LocalFrame> frames_;
  std::vector<Bits> bits_;
};

}  // namespace ktgp_orb::growth
