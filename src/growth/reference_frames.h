#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "growth/local_frame.h"
#include "growth/local_matcher.h"
#include "ktgp_orb/growth.h"

namespace ktgp_orb::growth {

/// The keypoints of the reference and of its simulated views, all in px of the reference. Reuses
/// its buffers from call to call.
class ReferenceFrames {
 public:
  /// `views`: may be null.
  void set(const Features& reference, const ReferenceViews* views);

  /// Maps the keypoints within `reach` px of `centre` into the target. `map`: reference to target.
  /// Uses only the views that look like the target around the centre, since descriptors and
  /// directions can agree only if the map from the view to the target has little tilt. Leaves out
  /// keypoints more than `kMargin` px outside the target. Returns false, without predictions, if
  /// the map mirrors around the centre, or has a tilt or scale there that descriptors do not
  /// tolerate.
  bool predict(const Eigen::Matrix3d& map, const Eigen::Vector2d& centre, double reach,
               const cv::Size& target, std::vector<Prediction>& predictions);
  static constexpr float kMargin = 50.F;

  const std::vector<LocalFrame>& frames() const { return frames_; }
  const std::vector<Bits>& bits() const { return bits_; }
  /// Linear part of the map from the reference to the view in which this keypoint was found.
  const Eigen::Matrix2f& toView(std::size_t keypoint) const {
    return views_[view_of_[keypoint]].to_view;
  }

 private:
  struct View {
    std::size_t begin, end;     // the view has the keypoints [begin, end)
    Eigen::Matrix2d from_view;  // linear part of the map from the view to the reference
    Eigen::Matrix2f to_view;    // inverse of from_view
  };

  void add(const Features& features, const Eigen::Matrix<double, 2, 3>& to_view);
  bool chooseViews(const Eigen::Matrix2d& jacobian);

  std::vector<View> views_;
  std::vector<double> squeeze_;  // tilt of the map from each view to the target, see squeezeOf()
  std::vector<std::uint8_t> chosen_;
  std::vector<std::uint16_t> view_of_;  // index of the view of each keypoint
  std::vector<LocalFrame> frames_;
  std::vector<Bits> bits_;
};

}  // namespace ktgp_orb::growth
