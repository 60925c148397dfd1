#pragma once

#include <Eigen/Core>
#include <opencv2/core.hpp>
#include <optional>
#include <vector>

namespace ktgp_orb {

/// Whether this build can find it (needs Clp).
bool hasSteadyPath();

/// The steadiest path of a camera over a whole recording.
///
/// A window of the frame's proportions, smaller by `max_crop` at each border, moves within each
/// frame. Its corners are the variables: each stays within its share of the margin, so nothing
/// beyond the border is ever seen. Among all such paths this is the one with the least weighted sum
/// of the absolute first, second and third differences of the motion that remains (L1-optimal
/// camera paths: Grundmann, Kwatra & Essa, "Auto-directed video stabilization with robust L1
/// optimal camera paths", CVPR 2011): it stands still, moves evenly or accelerates evenly.
///
/// `steps`: one per frame, the homography previous frame -> frame, px; empty for the first one and
/// where none was found, a scene cut for example: there the path begins anew, with the window where
/// it was. Returns for each frame the homography frame -> steady picture of the same size. Throws
/// std::invalid_argument for a crop out of 0.01..0.4, and std::runtime_error without a solver.
std::vector<Eigen::Matrix3d> steadyPath(const std::vector<std::optional<Eigen::Matrix3d>>& steps,
                                        const cv::Size& size, double max_crop);

}  // namespace ktgp_orb
