#include "core/homography/refiner.h"

#include <optional>
#include <stdexcept>
#include <string>

namespace ktgp_orb {
namespace {

/// The pairs as they come.
struct InputOrder {
  std::size_t operator[](std::size_t place) const { return place; }
};

}  // namespace

bool HomographyRefiner::refine(const std::vector<Eigen::Vector2d>& reference,
                               const std::vector<Eigen::Vector2d>& target,
                               const RefinerOptions& options, Eigen::Matrix3d& homography,
                               Covariance8* covariance) {
  if (reference.size() != target.size()) {
    throw std::invalid_argument("there are " + std::to_string(reference.size()) +
                                " reference points and " + std::to_string(target.size()) +
                                " target points; expected equal numbers");
  }
  if (reference.empty()) return false;
  problem_.load(reference, target, InputOrder(), options.max_error);
  std::optional<Eigen::Matrix3d> h = problem_.fromPixels(homography);
  if (!h || fit_.fit(problem_, options.min_scale, *h) != FitOutcome::fitted) return false;
  const Eigen::Matrix3d pixel = problem_.toPixels(*h);
  const Eigen::Matrix3d refined = pixel / pixel(2, 2);
  if (!refined.allFinite()) return false;
  homography = refined;
  if (covariance != nullptr) *covariance = fit_.pixelCovariance(problem_, *h);
  return true;
}

}  // namespace ktgp_orb
