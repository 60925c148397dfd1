#pragma once

#include <Eigen/Core>
#include <opencv2/core.hpp>
#include <optional>
#include <vector>

namespace ktgp_orb {

/// Whether this build has the solver (Clp) for steadyPath().
bool hasSteadyPath();

/// Finds the steadiest path of a camera over a whole recording.
///
/// A window of the frame's proportions, smaller by `max_crop` at each border, moves within each
/// frame. The positions of its corners are the variables. Each corner stays within its share of the
/// margin, so nothing beyond the border of the frame is ever shown. Among these paths, steadyPath()
/// finds the path whose remaining motion has the least weighted sum of the absolute first, second
/// and third differences (L1-optimal camera paths: Grundmann, Kwatra & Essa, "Auto-directed video
/// stabilization with robust L1 optimal camera paths", CVPR 2011). On such a path the camera stands
/// still, moves evenly or accelerates evenly.
///
/// `steps`: for each frame the homography from the previous frame to this frame, px. It is empty
/// for the first frame and for frames without a match, for example after a scene cut. At such a
/// frame the path begins anew, and the window stays in place. Returns for each frame the homography
/// from the frame to the steady picture, which has the same size. Throws std::invalid_argument if
/// `max_crop` is not in 0.01..0.4, and std::runtime_error if this build has no solver.
std::vector<Eigen::Matrix3d> steadyPath(const std::vector<std::optional<Eigen::Matrix3d>>& steps,
                                        const cv::Size& size, double max_crop);

}  // namespace ktgp_orb
