#include "ktgp_orb/frame_path.h"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <stdexcept>

namespace ktgp_orb {
namespace {

/// Scales the homography so that its largest entry is 1. Otherwise long products could underflow or
/// overflow.
Eigen::Matrix3d scaled(const Eigen::Matrix3d& h) {
  return h / h.cwiseAbs().maxCoeff();
}

}  // namespace

bool FramePath::isUsable(const Eigen::Matrix3d& homography) {
  return homography.allFinite() && std::abs(scaled(homography).determinant()) > 1e-12;
}

FramePath::FramePath(std::size_t length) : length_(length) {
  if (length == 0) throw std::invalid_argument("length of a path is 0; expected at least 1");
}

const FramePath::Step* FramePath::find(std::int64_t stamp) const {
  const auto found = std::find_if(steps_.rbegin(), steps_.rend(),
                                  [&](const Step& step) { return step.stamp == stamp; });
  if (found != steps_.rend()) return &*found;
  return reference_ && reference_->stamp == stamp ? &*reference_ : nullptr;
}

bool FramePath::add(std::int64_t stamp, std::int64_t reference_stamp,
                    const std::optional<Eigen::Matrix3d>& homography) {
  if (!homography || !isUsable(*homography)) {
    clear();
    steps_.push_back({stamp, Eigen::Matrix3d::Identity()});
    return false;
  }
  const Step* reference = find(reference_stamp);
  const bool connected = reference != nullptr;
  if (!connected) {
    clear();
    steps_.push_back({reference_stamp, Eigen::Matrix3d::Identity()});
    reference = &steps_.back();
  }
  const Eigen::Matrix3d step = *homography * reference->to_newest.inverse();
  const std::int64_t known = reference->stamp;
  for (Step& each : steps_) each.to_newest = scaled(step * each.to_newest);
  if (reference_) reference_->to_newest = scaled(step * reference_->to_newest);
  reference_ = Step{known, scaled(*homography)};
  steps_.push_back({stamp, Eigen::Matrix3d::Identity()});
  while (steps_.size() > length_) steps_.pop_front();
  return connected;
}

std::optional<Eigen::Matrix3d> FramePath::between(std::int64_t from, std::int64_t to) const {
  const Step* first = find(from);
  const Step* second = find(to);
  if (first == nullptr || second == nullptr) return std::nullopt;
  return scaled(second->to_newest.inverse() * first->to_newest);
}

void FramePath::clear() {
  steps_.clear();
  reference_.reset();
}

}  // namespace ktgp_orb
