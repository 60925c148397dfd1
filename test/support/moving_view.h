#pragma once

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <opencv2/core.hpp>

#include "ktgp_orb/sequence_matcher.h"
#include "orb_test_images.h"

namespace ktgp_orb::test {

const cv::Size kView(320, 240);

/// Grey value that a camera sees at (x, y) of a picture.
inline cv::Mat viewAt(int x, int y) {
  static const cv::Mat world = textureImage(cv::Size(1200, 600), 1);
  return world(cv::Rect(cv::Point(x, y), kView)).clone();
}

inline SequenceOptions sequenceOf(ReferenceMode mode, double search_radius = 0.0) {
  SequenceOptions options;
  options.orb.max_features = 500;
  options.matcher.knn.search_radius = search_radius;
  options.reference.mode = mode;
  return options;
}

/// A frame of the matcher's pool with that image.
inline FramePtr frameOf(SequenceMatcher& matcher, const cv::Mat& image) {
  const FramePtr frame = matcher.newFrame();
  frame->image = image;
  return frame;
}

/// Checks that H moves the centre of a view by (x, y).
inline void expectTranslation(const Eigen::Matrix3d& h, double x, double y,
                              double tolerance = 0.3) {
  const Eigen::Vector2d centre(0.5 * kView.width, 0.5 * kView.height);
  const Eigen::Vector2d moved = (h * centre.homogeneous()).hnormalized() - centre;
  EXPECT_NEAR(moved.x(), x, tolerance);
  EXPECT_NEAR(moved.y(), y, tolerance);
}

}  // namespace ktgp_orb::test
