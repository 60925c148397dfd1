#pragma once

#include <Eigen/Core>
#include <opencv2/core.hpp>
#include <optional>
#include <vector>

namespace ktgp_orb {

/// Returns true if this build has Clp, the solver that steadyPath() needs.
bool hasSteadyPath();

/// Finds the steadiest path of a camera over a whole recording.
///
/// A window with the proportions of the frame, smaller by the share `max_crop` at each border,
/// moves within each frame; its content is the steady picture. A corner of the window may move at
/// most to the border of the frame, so nothing beyond the border is ever shown, and the window may
/// change its shape only a little. Within these limits, steadyPath() chooses the positions of the
/// corners in all frames so that the steady picture moves least: it minimises a weighted sum of the
/// motion that remains at a corner, the change of this motion from frame to frame, and the change
/// of this change (absolute first, second and third differences; L1-optimal camera paths:
/// Grundmann, Kwatra & Essa, "Auto-directed video stabilization with robust L1 optimal camera
/// paths", CVPR 2011). In the steady picture, the camera then seems to stand still, to move evenly
/// or to accelerate evenly.
///
/// `steps`: for each frame, the homography from the previous frame to this frame, px. It is empty
/// for the first frame and for frames without a match, for example after a scene cut. At such a
/// frame a new path begins, and the window stays where it was in the previous frame. Returns, for
/// each frame, the homography from the frame to the steady picture, which has the same size. Throws
/// std::invalid_argument if `max_crop` is not in 0.01..0.4, and std::runtime_error if this build
/// has no solver.
std::vector<Eigen::Matrix3d> steadyPath(const std::vector<std::optional<Eigen::Matrix3d>>& steps,
                                        const cv::Size& size, double max_crop);

}  // namespace ktgp_orb
