#pragma once

#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <opencv2/imgproc.hpp>
#include <string>
#include <utility>

#include "frame_pair.h"
#include "synthetic_pairs.h"

namespace ktgp_orb::test {

/// Sheets that repeat themselves: the same symbols in a grid, with other labels.
enum class Page { text, form, table, facade, circuit, diagram, seats, meters };
constexpr std::array<Page, 6> kPages{Page::text,   Page::form,    Page::table,
                                     Page::facade, Page::circuit, Page::diagram};
/// Sheets that were not looked at while the limits of growth were chosen.
constexpr std::array<Page, 2> kHeldBackPages{Page::seats, Page::meters};

inline const char* nameOf(Page page) {
  constexpr std::array<const char*, 8> kNames{"text",    "form",    "table", "facade",
                                              "circuit", "diagram", "seats", "meters"};
  return kNames[static_cast<std::size_t>(page)];
}

/// Draws in units of a page. The sheet has `zoom` px for each unit.
class PagePen {
 public:
  PagePen(const cv::Size& size, int paper, std::uint64_t seed, double zoom)
      : sheet(cvRound(zoom * size.height), cvRound(zoom * size.width), CV_8U, cv::Scalar(paper)),
        zoom_(zoom),
        numbers_(seed) {}

  int below(int limit) { return static_cast<int>(numbers_.uniform(0.0, limit)); }
  std::string word(int letters) {
    std::string text;
    for (int i = 0; i < letters; ++i) text += static_cast<char>('a' + below(26));
    return text;
  }
  std::string number(int limit) { return std::to_string(below(limit)); }
  void write(const std::string& text, int x, int y, double height = 0.6, int ink = 0) {
    cv::putText(sheet, text, at(x, y), cv::FONT_HERSHEY_SIMPLEX, zoom_ * height, cv::Scalar(ink),
                px(1), cv::LINE_AA);
  }
  void box(int x, int y, int width, int height, int ink, int line) {
    cv::rectangle(sheet, cv::Rect(at(x, y), cv::Size(px(width), px(height))), cv::Scalar(ink),
                  line < 0 ? line : px(line));
  }
  void line(int x, int y, int dx, int dy, int ink, int width = 2) {
    cv::line(sheet, at(x, y), at(x + dx, y + dy), cv::Scalar(ink), px(width), cv::LINE_AA);
  }
  void disc(int x, int y, int radius, int ink, int line = cv::FILLED) {
    cv::circle(sheet, at(x, y), px(radius), cv::Scalar(ink), line < 0 ? line : px(line),
               cv::LINE_AA);
  }

  cv::Mat sheet;

 private:
  int px(int units) const { return cvRound(zoom_ * units); }
  cv::Point at(int x, int y) const { return {px(x), px(y)}; }

  double zoom_;
  Numbers numbers_;
};

inline void drawWindow(PagePen& pen, int x, int y) {
  pen.box(x, y, 80, 120, 60, cv::FILLED);
  pen.box(x - 6, y - 6, 92, 132, 230, 4);
  pen.line(x + 40, y, 0, 120, 230, 4);
  pen.line(x, y + 45, 80, 0, 230, 4);
  if (pen.below(2) == 0) pen.box(x + 4, y + 4, 32, 6 + pen.below(30), 90 + pen.below(110), -1);
  if (pen.below(2) == 0) pen.box(x + 44, y + 70, 6 + pen.below(26), 46, 90 + pen.below(110), -1);
  if (pen.below(3) == 0) pen.disc(x + 60, y + 90, 5 + pen.below(9), pen.below(255));
}

inline void drawChip(PagePen& pen, int x, int y) {
  pen.box(x, y, 90, 60, 20, cv::FILLED);
  for (int k = 0; k < 8; ++k) {
    pen.box(x + 4 + 11 * k, y - 12, 6, 13, 220, cv::FILLED);
    pen.box(x + 4 + 11 * k, y + 60, 6, 13, 220, cv::FILLED);
  }
  pen.disc(x + 10, y + 10, 4, 120);
  pen.write("U" + pen.number(999), x + 20, y + 38, 0.6, 230);
}

inline void drawRelay(PagePen& pen, int x, int y) {
  pen.box(x - 22, y, 45, 61, 0, 2);
  pen.disc(x, y + 110, 14, 0, 2);
  pen.line(x - 14, y + 110, 28, 0, 0);
  pen.write("K" + std::to_string(10 + pen.below(90)) + "." + pen.number(10), x + 26, y + 40);
}

/// A chair of a seating plan, with the number of the seat.
inline void drawSeat(PagePen& pen, int x, int y) {
  pen.disc(x + 30, y + 30, 26, 0, 2);
  pen.box(x + 12, y + 52, 36, 8, 90, cv::FILLED);
  pen.write(pen.number(200), x + 12, y + 36, 0.5);
}

/// A dial of a board of meters. Its hand and its last digits differ.
inline void drawMeter(PagePen& pen, int x, int y) {
  constexpr double kTick = 0.5;  // rad
  const auto along = [](double angle, double length) {
    return std::pair(cvRound(length * std::cos(angle)), cvRound(length * std::sin(angle)));
  };
  pen.disc(x, y, 56, 235);
  pen.disc(x, y, 56, 20, 4);
  for (double angle = 0.0; angle < 6.0; angle += kTick) {
    const auto [from_x, from_y] = along(angle, 42.0);
    const auto [dx, dy] = along(angle, 9.0);
    pen.line(x + from_x, y + from_y, dx, dy, 20);
  }
  const auto [dx, dy] = along(kTick * pen.below(12), 36.0);
  pen.line(x, y, dx, dy, 20, 4);
  pen.box(x - 30, y + 64, 60, 20, 20, 2);
  pen.write("00" + pen.number(1000), x - 26, y + 80, 0.5);
}

/// `size`: size of the sheet in its units. `zoom`: px for each unit.
inline cv::Mat sheetOf(Page page, const cv::Size& size, std::uint64_t seed, double zoom = 1.0) {
  const bool is_board = page == Page::circuit;
  PagePen pen(size, is_board ? 70 : page == Page::facade ? 190 : 255, seed, zoom);
  const auto forGrid = [&](int dx, int dy, auto draw) {
    for (int x = 40; x < size.width - dx; x += dx) {
      for (int y = 40; y < size.height - dy; y += dy) draw(x, y);
    }
  };
  if (page == Page::text) {
    forGrid(110, 38, [&](int x, int y) { pen.write(pen.word(2 + pen.below(4)), x, y, 0.8); });
  } else if (page == Page::form) {
    forGrid(360, 90, [&](int x, int y) {
      pen.box(x, y, 330, 60, 0, 2);
      pen.write(x % 720 == 40 ? "Name" : "Date", x + 6, y + 20, 0.5);
      pen.write(pen.word(3 + pen.below(7)) + pen.number(100), x + 70, y + 48, 0.8);
    });
  } else if (page == Page::table) {
    forGrid(110, 40, [&](int x, int y) {
      pen.box(x, y, 110, 40, 0, 1);
      pen.write(pen.number(1000) + "." + pen.number(100), x + 8, y + 28);
    });
  } else if (page == Page::facade) {
    forGrid(150, 190, [&](int x, int y) { drawWindow(pen, x, y); });
  } else if (page == Page::circuit) {
    forGrid(160, 130, [&](int x, int y) { drawChip(pen, x + 20, y + 20); });
  } else if (page == Page::seats) {
    forGrid(85, 95, [&](int x, int y) { drawSeat(pen, x, y); });
  } else if (page == Page::meters) {
    forGrid(145, 175, [&](int x, int y) { drawMeter(pen, x + 62, y + 62); });
  } else {
    forGrid(135, 200, [&](int x, int y) { drawRelay(pen, x + 40, y + 20); });
  }
  // Wires and cracks that exist once.
  const int lines = page == Page::facade || is_board ? size.area() / 10000 : size.width / 200;
  for (int i = 0; i < lines; ++i) {
    const int x = pen.below(size.width), y = pen.below(size.height);
    pen.line(x, y, pen.below(161) - 80, is_board ? 0 : pen.below(61) - 30, is_board ? 130 : 80);
  }
  return pen.sheet;
}

/// A scan or photograph of a part of a sheet.
struct Scan {
  cv::Size size{1500, 1100};  ///< px
  double zoom = 1.0;          ///< px for each unit of the sheet
  /// Perspective: the scale is divided by 1 + slant at the right edge, and by 1 - slant at the
  /// lower.
  double slant = 0.0;
};
/// A scan at 400 dpi, if the other scan has 150 dpi.
inline Scan fineScan() {
  return {{4000, 2933}, 8.0 / 3.0, 0.0};
}
/// A photograph from near: each of its px shows 0.4 units of the sheet in its middle.
inline Scan nearPhotograph() {
  return {{1500, 1100}, 2.5, 0.15};
}

/// Two scans of one sheet, turned a little, and the homography between them.
struct ScannedPair {
  FramePair frames;
  Eigen::Matrix3d truth;
};

/// px of the sheet -> px of the scan. `left`: left edge of the scan, units of the sheet.
inline Eigen::Matrix3d scanning(const Scan& scan, double left, double angle) {
  constexpr double kHeight = 1100.0;  // height of the sheet
  const double top = 0.5 * (kHeight - scan.size.height / scan.zoom);
  Eigen::Matrix3d turn = Eigen::Matrix3d::Identity();
  turn.topLeftCorner<2, 2>() << std::cos(angle), -std::sin(angle), std::sin(angle), std::cos(angle);
  Eigen::Matrix3d slant = Eigen::Matrix3d::Identity();
  slant.row(2) << 2.0 * scan.slant / scan.size.width, -2.0 * scan.slant / scan.size.height, 1.0;
  const double x = 0.5 * scan.size.width, y = 0.5 * scan.size.height;
  return translation(x, y) * slant * translation(-x, -y) * turn *
         translation(-scan.zoom * left, -scan.zoom * top);
}

/// The first scan has 1500 x 1100 px, one for each unit of the sheet. `overlap`: share of its width
/// that both show, 0..1; 0: only the symbols are the same.
inline ScannedPair scannedPair(Page page, double overlap, std::uint64_t seed, const OrbOptions& orb,
                               const Scan& second = {}) {
  const Scan first;
  const cv::Size sheet_size(2 * first.size.width + 100, first.size.height);
  Numbers numbers(seed + 1000);
  const auto shown = [&](const Scan& scan, double left, const Eigen::Matrix3d& to_scan) {
    const cv::Mat sheet = sheetOf(page, sheet_size, seed, scan.zoom);
    cv::Mat image = warped(sheet, to_scan, scan.size, cv::INTER_LINEAR);
    cv::GaussianBlur(image, image, {}, 0.7);
    cv::Mat noise(scan.size, CV_16S);
    cv::RNG(seed + static_cast<std::uint64_t>(left)).fill(noise, cv::RNG::NORMAL, 0.0, 5.0);
    cv::add(image, noise, image, cv::noArray(), CV_8U);
    return image;
  };
  const double left = 40.0, right = left + first.size.width * (1.0 - overlap);
  const Eigen::Matrix3d a = scanning(first, left, numbers.uniform(-0.012, 0.012));
  const Eigen::Matrix3d b = scanning(second, right, numbers.uniform(-0.012, 0.012));
  const Eigen::Matrix3d zoom = Eigen::Vector3d(second.zoom, second.zoom, 1.0).asDiagonal();
  return {FramePair(shown(first, left, a), shown(second, right, b), orb), b * zoom * a.inverse()};
}

/// As preset photo has it.
inline OrbOptions pageFeatures() {
  OrbOptions orb;
  orb.max_features = 4500;
  orb.fast_threshold = 10;
  orb.descriptor = DescriptorKind::teblid;
  return orb;
}

/// Pairs of scanned pages of one kind: how many are found, and how many of these are wrong.
struct PageCounts {
  int pairs = 0, found = 0, wrong = 0;
};

/// Preset robust, seeds from `first` to before `last`; names the pairs that are not as they should.
/// A homography is wrong if it is off by more than 3 px.
template <std::size_t N = kPages.size()>
PageCounts countPages(double overlap, std::uint64_t first, std::uint64_t last,
                      const Scan& second = {}, const std::array<Page, N>& pages = kPages) {
  const double right_within = 3.0 * second.zoom;  // px, in the middle of what both show
  const Eigen::Vector2d shown(1500.0 * (1.0 - 0.5 * overlap), 550.0);
  KtgpMatcher matcher(MatcherOptions::robust());
  MatchResult result;
  PageCounts counts;
  for (const Page page : pages) {
    for (std::uint64_t seed = first; seed < last; ++seed) {
      const ScannedPair pair = scannedPair(page, overlap, seed, pageFeatures(), second);
      matcher.match(pair.frames.reference, pair.frames.target, result);
      const bool found = result.status == Status::ok;
      const bool right =
          found &&
          (apply(result.answer.homography, shown) - apply(pair.truth, shown)).norm() < right_within;
      ++counts.pairs;
      counts.found += found ? 1 : 0;
      counts.wrong += found && !right ? 1 : 0;
      if (found == (overlap > 0.0) && found == right) continue;
      std::printf("%s %d, zoom %.2f, overlap %.2f: %s\n", nameOf(page), static_cast<int>(seed),
                  second.zoom, overlap, found ? "wrong" : "not found");
    }
  }
  return counts;
}

}  // namespace ktgp_orb::test
