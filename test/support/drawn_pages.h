#pragma once

#include <array>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <opencv2/imgproc.hpp>
#include <string>
#include <utility>

#include "frame_pair.h"
#include "synthetic_pairs.h"

namespace ktgp_orb::test {

/// Sheets that repeat themselves: the same symbols in a grid, with other labels.
enum class Page { text, form, table, facade, circuit, diagram };
constexpr std::array<Page, 6> kPages{Page::text,   Page::form,    Page::table,
                                     Page::facade, Page::circuit, Page::diagram};

inline const char* nameOf(Page page) {
  constexpr std::array<const char*, 6> kNames{"text",   "form",    "table",
                                              "facade", "circuit", "diagram"};
  return kNames[static_cast<std::size_t>(page)];
}

class PagePen {
 public:
  PagePen(const cv::Size& size, int paper, std::uint64_t seed)
      : sheet(size, CV_8U, cv::Scalar(paper)), numbers_(seed) {}

  int below(int limit) { return static_cast<int>(numbers_.uniform(0.0, limit)); }
  std::string word(int letters) {
    std::string text;
    for (int i = 0; i < letters; ++i) text += static_cast<char>('a' + below(26));
    return text;
  }
  std::string number(int limit) { return std::to_string(below(limit)); }
  void write(const std::string& text, int x, int y, double height = 0.6, int ink = 0) {
    cv::putText(sheet, text, {x, y}, cv::FONT_HERSHEY_SIMPLEX, height, cv::Scalar(ink), 1,
                cv::LINE_AA);
  }
  void box(int x, int y, int width, int height, int ink, int line) {
    cv::rectangle(sheet, cv::Rect(x, y, width, height), cv::Scalar(ink), line);
  }
  void line(int x, int y, int dx, int dy, int ink, int width = 2) {
    cv::line(sheet, {x, y}, {x + dx, y + dy}, cv::Scalar(ink), width, cv::LINE_AA);
  }
  void disc(int x, int y, int radius, int ink, int line = cv::FILLED) {
    cv::circle(sheet, {x, y}, radius, cv::Scalar(ink), line, cv::LINE_AA);
  }

  cv::Mat sheet;

 private:
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

inline cv::Mat sheetOf(Page page, const cv::Size& size, std::uint64_t seed) {
  const bool is_board = page == Page::circuit;
  PagePen pen(size, is_board ? 70 : page == Page::facade ? 190 : 255, seed);
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

/// Two scans of one sheet, 1500 x 1100 px, turned a little, and the homography between them.
struct ScannedPair {
  FramePair frames;
  Eigen::Matrix3d truth;
};

/// `overlap`: share of the width that both show, 0..1; 0: only the symbols are the same.
inline ScannedPair scannedPair(Page page, double overlap, std::uint64_t seed,
                               const OrbOptions& orb) {
  const cv::Size size(1500, 1100);
  const cv::Mat sheet = sheetOf(page, {2 * size.width + 100, size.height}, seed);
  Numbers numbers(seed + 1000);
  const auto scan = [&](double x, const Eigen::Matrix3d& to_scan) {
    cv::Mat image = warped(sheet, to_scan * translation(-x, 0.0), size, cv::INTER_LINEAR);
    cv::GaussianBlur(image, image, {}, 0.7);
    cv::Mat noise(size, CV_16S);
    cv::RNG(seed + static_cast<std::uint64_t>(x)).fill(noise, cv::RNG::NORMAL, 0.0, 5.0);
    cv::add(image, noise, image, cv::noArray(), CV_8U);
    return image;
  };
  const auto turned = [&] {
    const double angle = numbers.uniform(-0.012, 0.012);
    Eigen::Matrix3d turn = Eigen::Matrix3d::Identity();
    turn.topLeftCorner<2, 2>() << std::cos(angle), -std::sin(angle), std::sin(angle),
        std::cos(angle);
    return turn;
  };
  const Eigen::Matrix3d a = turned(), b = turned();
  const double left = 40.0, right = left + size.width * (1.0 - overlap);
  return {FramePair(scan(left, a), scan(right, b), orb),
          b * translation(left - right, 0.0) * a.inverse()};
}

/// As preset photo has it.
inline OrbOptions pageFeatures() {
  OrbOptions orb;
  orb.max_features = 4500;
  orb.fast_threshold = 10;
  orb.descriptor = DescriptorKind::teblid;
  return orb;
}

/// Of pairs of scanned pages of each kind: how many are found, and how many of these are wrong.
struct PageCounts {
  int pairs = 0, found = 0, wrong = 0;
};

/// Preset robust, seeds from `first` to before `last`; names the pairs that are not as they should.
inline PageCounts countPages(double overlap, std::uint64_t first, std::uint64_t last) {
  constexpr double kRight = 3.0;  // px, in the middle of what both show
  const Eigen::Vector2d shown(1500.0 * (1.0 - 0.5 * overlap), 550.0);
  KtgpMatcher matcher(MatcherOptions::robust());
  MatchResult result;
  PageCounts counts;
  for (const Page page : kPages) {
    for (std::uint64_t seed = first; seed < last; ++seed) {
      const ScannedPair pair = scannedPair(page, overlap, seed, pageFeatures());
      matcher.match(pair.frames.reference, pair.frames.target, result);
      const bool found = result.status == Status::ok;
      const bool right =
          found &&
          (apply(result.answer.homography, shown) - apply(pair.truth, shown)).norm() < kRight;
      ++counts.pairs;
      counts.found += found ? 1 : 0;
      counts.wrong += found && !right ? 1 : 0;
      if (found == (overlap > 0.0) && found == right) continue;
      std::printf("%s %d, overlap %.2f: %s\n", nameOf(page), static_cast<int>(seed), overlap,
                  found ? "wrong" : "not found");
    }
  }
  return counts;
}

}  // namespace ktgp_orb::test
