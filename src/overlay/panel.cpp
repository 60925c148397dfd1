#include "overlay/styles.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <opencv2/imgproc.hpp>
#include <string>

#include "core/homography/transform.h"
#include "core/util/format.h"
#include "overlay/palette.h"
#include "overlay/text.h"

namespace ktgp_orb::overlay {
namespace {

using util::format;

constexpr std::array<Level, 4> kLevels{Level::ktgp, Level::ktg, Level::kt, Level::knn};

std::array<std::size_t, 4> countLevels(const std::vector<Correspondence>& correspondences) {
  std::array<std::size_t, 4> counts{};
  for (const Correspondence& c : correspondences) {
    ++counts[std::min<std::size_t>(static_cast<std::size_t>(c.level), counts.size() - 1)];
  }
  return counts;
}

std::string headline(const MatchResult& result, const cv::Size& reference_size) {
  const bool epipolar = result.geometry == Geometry::epipolar;
  std::string text =
      format("%s  %.1f ms", epipolar ? toString(result.geometry) : toString(result.status),
             result.milliseconds());
  if (epipolar && std::isfinite(result.two_view.view.parallax)) {
    return text + format("  parallax %.1f deg", result.two_view.view.parallax);
  }
  if (result.status != Status::ok) return text;
  const double deviation =
      homography::cornerDeviation(result.answer.homography, result.answer.covariance,
                                  homography::imageCorners(reference_size, {}))
          .target;
  if (!std::isfinite(deviation)) return text;
  text += format("  corners +-%.*f px", deviation < 10.0 ? 2 : 0, deviation);
  if (result.answer.plane_deviation > 0.0) {
    text += format("  plane %.2f px", result.answer.plane_deviation);
  }
  return text;
}

}  // namespace

void drawPanel(const MatchResult& result, const cv::Size& reference_size, int top,
               cv::Mat& canvas) {
  const Typeface face(canvas.size());
  const int line = face.lineHeight();
  const int margin = line / 3;
  const std::array<std::size_t, 4> counts = countLevels(result.correspondences);
  const double total = static_cast<double>(std::max<std::size_t>(result.correspondences.size(), 1));

  const std::string title = headline(result, reference_size);
  const int label_width = face.width(lookOf(Level::ktg, result.geometry).label) + margin;
  const int count_width = face.width("0000000");
  const int bar_start = 2 * margin + label_width + count_width;
  const int width = std::max(face.width(title) + 2 * margin, bar_start + 3 * line);
  const int height = 5 * line + 2 * margin;
  if (top + height > canvas.rows) top = 0;
  darken(canvas, {0, top, width, height});
  face.draw(canvas, title, {margin, top + margin});
  int y = top + margin + line;
  for (const Level level : kLevels) {
    const std::size_t count = counts[static_cast<std::size_t>(level)];
    const std::string number = std::to_string(count);
    face.draw(canvas, lookOf(level, result.geometry).label, {margin, y});
    face.draw(canvas, number, {bar_start - margin - face.width(number), y});
    const int longest = width - margin - bar_start;
    const int length =
        std::max(2, static_cast<int>(std::lround(longest * static_cast<double>(count) / total)));
    cv::rectangle(canvas, cv::Rect(bar_start, y + line / 4, length, line / 2),
                  lookOf(level, result.geometry).colour, cv::FILLED);
    y += line;
  }
}

}  // namespace ktgp_orb::overlay
