#pragma once

namespace ktgp_orb::homography {

/// Calls `visit` with the name of each number of an answer (UncertainHomography), and with the
/// members of that name of `holders`: answers, messages, or none.
template <typename Visit, typename... Holders>
void visitNumbers(Visit visit, Holders&... holders) {
  visit("plane_deviation", holders.plane_deviation...);
}

/// The same for all fields that messages and files have.
template <typename Visit, typename... Holders>
void visitAnswer(Visit visit, Holders&... holders) {
  visit("homography", holders.homography...);
  visit("covariance", holders.covariance...);
  visitNumbers(visit, holders...);
}

}  // namespace ktgp_orb::homography
