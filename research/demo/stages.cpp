#include "demo/stages.h"

#include <Eigen/Geometry>
#include <filesystem>
#include <opencv2/core/eigen.hpp>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <vector>

#include "ktgp_orb/ktgp_matcher.h"
#include "ktgp_orb/orb_extractor.h"
#include "overlay/canvas.h"
#include "util/format.h"
#include "util/keypoint_position.h"

namespace ktgp_orb::demo {
namespace {

// Colours that all kinds of colour vision can distinguish (Okabe & Ito, 2008), BGR.
const cv::Scalar kRight(233, 180, 86);
const cv::Scalar kWrong(0, 60, 230);
constexpr double kLimit = 3.0;  // px; the limit of doc/method.md for precision

cv::Mat greyOf(const cv::Mat& image) {
  if (image.channels() == 1) return image;
  cv::Mat grey;
  cv::cvtColor(image, grey, cv::COLOR_BGR2GRAY);
  return grey;
}

struct Line {
  cv::Point2f from, to;
  bool right;
};

/// The matches that reached `level`.
std::vector<Line> linesAt(Level level, const Features& reference, const Features& target,
                          const MatchResult& result, const Eigen::Matrix3d& truth) {
  std::vector<Line> lines;
  for (const Correspondence& match : result.correspondences) {
    if (match.level < level || match.reference_index < 0) continue;
    const cv::Point2f from = util::imagePoint(reference, match.reference_index);
    const cv::Point2f to = util::imagePoint(target, match.target_index);
    const Eigen::Vector2d expected = (truth * Eigen::Vector3d(from.x, from.y, 1.0)).hnormalized();
    lines.push_back({from, to, (expected - Eigen::Vector2d(to.x, to.y)).norm() <= kLimit});
  }
  return lines;
}

cv::Mat drawPanel(const KnownPair& pair, const std::string& name, const std::vector<Line>& lines) {
  const int height = std::max(pair.reference.rows, pair.target.rows);
  cv::Mat panel(height, pair.reference.cols + pair.target.cols, CV_8UC3, overlay::kBlack);
  const cv::Point offset(pair.reference.cols, 0);
  overlay::copyAsBgr(pair.reference, panel(cv::Rect({0, 0}, pair.reference.size())));
  overlay::copyAsBgr(pair.target, panel(cv::Rect(offset, pair.target.size())));
  panel *= 0.6;
  const overlay::Typeface face(panel.size());
  constexpr std::size_t kMost = 60;  // more lines hide the images
  const std::size_t step = std::max<std::size_t>(1, (lines.size() + kMost - 1) / kMost);
  std::size_t right = 0;
  for (std::size_t i = 0; i < lines.size(); ++i) {
    right += lines[i].right ? 1 : 0;
    if (i % step != 0) continue;
    cv::line(panel, lines[i].from, lines[i].to + cv::Point2f(offset),
             lines[i].right ? kRight : kWrong, face.stroke(), cv::LINE_AA);
  }
  const int margin = face.lineHeight() / 3;
  overlay::darken(panel, {0, 0, panel.cols, face.lineHeight() + 2 * margin});
  face.draw(panel,
            util::format("%s: %zu matches, %zu right (blue), %zu wrong (red)", name.c_str(),
                         lines.size(), right, lines.size() - right),
            {margin, margin});
  return panel;
}

}  // namespace

cv::Mat drawStages(const KnownPair& pair) {
  OrbExtractor extractor;
  Features reference;
  Features target;
  extractor.extract(greyOf(pair.reference), reference);
  extractor.extract(greyOf(pair.target), target);
  MatchResult result;
  KtgpMatcher matcher;
  matcher.match(reference, target, result);
  const char* const names[] = {"KNN", "KNN+TF", "KNN+TF+GMS", "KNN+TF+GMS+PROSAC"};
  cv::Mat panels[4];
  for (int i = 0; i < 4; ++i) {
    panels[i] = drawPanel(pair, names[i],
                          linesAt(static_cast<Level>(i), reference, target, result, pair.truth));
  }
  cv::Mat upper;
  cv::Mat lower;
  cv::Mat all;
  cv::hconcat(panels[0], panels[1], upper);
  cv::hconcat(panels[2], panels[3], lower);
  cv::vconcat(upper, lower, all);
  return all;
}

KnownPair graffiti() {
  const std::string folder = "/usr/share/doc/opencv-doc/examples/data/";
  KnownPair pair;
  const std::string truth = folder + "H1to3p.xml";
  if (!std::filesystem::exists(truth)) return pair;
  pair.reference = cv::imread(folder + "graf1.png");
  pair.target = cv::imread(folder + "graf3.png");
  cv::Mat homography;
  cv::FileStorage(truth, cv::FileStorage::READ).getFirstTopLevelNode() >> homography;
  cv::cv2eigen(homography, pair.truth);
  return pair;
}

}  // namespace ktgp_orb::demo
