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
/// moves within each frame; its content is the steady picture. The positions of its corners are the
/// variables. A corner may move at most to the border, so nothing beyond the border of the frame is
/// ever shown. Among these paths, steadyPath() finds the one with the smallest weighted sum of the
/// absolute first, second and third differences of the position, that is, of the remaining motion,
/// its change, and the change of its change (L1-optimal camera paths: Grundmann, Kwatra & Essa,
/// "Auto-directed video stabilization with robust L1 optimal camera paths", CVPR 2011). On such a
/// path the camera stands still, moves evenly or accelerates evenly.
///
/// `steps`: for each frame, the homography from the previous frame to this frame, px. It is empty
/// for the first frame and for frames without a match, for example after a scene cut. At such a
/// frame the path begins anew, and the window keeps its place in the frame. Returns, for each
/// frame, the homography from the frame to the steady picture, which has the same size. Throws
/// std::invalid_argument if `max_crop` is not in 0.01..0.4, and std::runtime_error if this build
/// has no solver.
std::vector<Eigen::Matrix3d> steadyPath(const std::vector<std::optional<Eigen::Matrix3d>>& steps,
                                        const cv::Size& size, double max_crop);

}  // namespace ktgp_orb
