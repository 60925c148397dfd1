#include "overlay/styles.h"

#include <opencv2/imgproc.hpp>

#include "core/util/keypoint_position.h"
#include "overlay/canvas.h"
#include "overlay/palette.h"
#include "overlay/text.h"

namespace ktgp_orb::overlay {
namespace {

using util::imagePoint;

constexpr std::size_t kMaxLines = 150;

}  // namespace

void drawMatches(const FrameView& reference, const FrameView& target, const MatchResult& result,
                 Level level, bool removed, cv::Mat& canvas) {
  drawSideBySide(reference.image, target.image, canvas);
  const int stroke = Typeface(canvas.size()).stroke();
  const cv::Point2f offset(static_cast<float>(reference.image.cols), 0.F);
  const auto from = [&](const Correspondence& c) {
    return imagePoint(reference.features, c.reference_index);
  };
  const auto to = [&](const Correspondence& c) {
    return imagePoint(target.features, c.target_index) + offset;
  };
  const auto dots = [&](const Correspondence& c) {
    const auto dot = [&](const cv::Point2f& p) {
      cv::circle(canvas, p, stroke, lookOf(c.level, result.geometry).colour, cv::FILLED,
                 cv::LINE_AA);
    };
    if (c.reference_index >= 0) dot(from(c));
    dot(to(c));
  };

  const std::size_t count = countAtLeast(result.correspondences, level);
  const std::size_t lines = std::min(count, kMaxLines);
  for (const Correspondence& c : result.correspondences) {
    if (c.level >= level || removed) dots(c);
  }
  std::size_t i = 0;
  for (const Correspondence& c : result.correspondences) {
    if (c.level < level || !isChosen(i++, count, lines)) continue;
    cv::line(canvas, from(c), to(c), lookOf(c.level, result.geometry).colour, stroke, cv::LINE_AA);
  }
}

}  // namespace ktgp_orb::overlay
