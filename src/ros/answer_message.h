#pragma once

#include <ktgp_orb/HomographyStamped.h>
#include <ktgp_orb/MatchStatus.h>

#include <boost/array.hpp>
#include <optional>

#include "homography/transform.h"
#include "ktgp_orb/prosac_homography.h"

namespace ktgp_orb {

/// Copies one field of a homography answer to a message field, or back. A message stores a matrix
/// as an array, row by row.
struct CopyField {
  void operator()(const char* /*name*/, double from, double& to) const { to = from; }
  template <int Size, int Options, std::size_t Entries>
  void operator()(const char* /*name*/, const Eigen::Matrix<double, Size, Size, Options>& from,
                  boost::array<double, Entries>& to) const {
    Eigen::Map<Eigen::Matrix<double, Size, Size, Eigen::RowMajor>>(to.data()) = from;
  }
  template <int Size, int Options, std::size_t Entries>
  void operator()(const char* /*name*/, const boost::array<double, Entries>& from,
                  Eigen::Matrix<double, Size, Size, Options>& to) const {
    to = Eigen::Map<const Eigen::Matrix<double, Size, Size, Eigen::RowMajor>>(from.data());
  }
};

/// Copies the answer to a message type that has all fields of UncertainHomography:
/// HomographyStamped or TargetDetection.
template <typename Message>
void copyAnswer(const UncertainHomography& answer, Message& message) {
  homography::visitAnswer(CopyField(), answer, message);
}

/// Reads the answer from the message; empty if no homography was found.
inline std::optional<UncertainHomography> answerOf(const HomographyStamped& message) {
  if (message.status != MatchStatus::STATUS_OK) return std::nullopt;
  UncertainHomography answer;
  homography::visitAnswer(CopyField(), message, answer);
  return answer;
}

}  // namespace ktgp_orb
