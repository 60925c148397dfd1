#include "targets/conflicts.h"

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>

#include "homography/transform.h"
#include "metrics/repetition.h"
#include "targets/appearance.h"
#include "targets/picture_aligner.h"

namespace ktgp_orb::targets {
namespace {

// Longer side of the small copy of a picture that ambiguityOf() compares with itself, px.
constexpr double kCopySide = 96.0;
// A shift by less than this share of the picture's width or height counts as no shift.
constexpr double kLeastMove = 0.08;
constexpr double kLeastAlike = 0.5;  // minimum correlation; low, since looksTheSame() is stricter
constexpr double kLeastAgreement = 0.6;  // minimum share of the blocks that look alike
constexpr double kLeastOverlap = 0.5;
// The outlines of two pictures with the same content overlap by more than this share of the larger.
constexpr double kSameOutline = 0.6;
// Maximum number of shifts tested for each of the four rotations (0, 90, 180 and 270 degrees).
constexpr std::size_t kMostPlaces = 4;

/// Returns the map from an image of `size` to the same image rotated clockwise by `quarters` x 90
/// degrees; both in px.
Eigen::Matrix3d turning(int quarters, const cv::Size& size) {
  Eigen::Matrix3d map = Eigen::Matrix3d::Identity();
  cv::Size now = size;
  for (int i = 0; i < quarters; ++i) {
    Eigen::Matrix3d quarter;
    quarter << 0, -1, now.height - 1, 1, 0, 0, 0, 0, 1;
    map = (quarter * map).eval();
    std::swap(now.width, now.height);
  }
  return map;
}

/// Returns the map from the picture to the image near `map` at which the patches of both agree
/// best.
Eigen::Matrix3d aligned(const TargetPicture& picture, const cv::Mat& image,
                        const Eigen::Matrix3d& map) {
  UncertainHomography exact;
  exact.homography = map;
  PointPairs pairs;
  PictureAligner().align(picture, {image}, exact, pairs);
  return exact.homography;
}

/// Returns true if the picture looks roughly like itself after `map` has moved it (px -> px).
bool looksTheSame(const TargetPicture& picture, const Eigen::Matrix3d& map) {
  const Eigen::Matrix3d exact = aligned(picture, picture.image, map);
  if (homography::overlap(exact, picture.image.size()) < kLeastOverlap) return false;
  return Appearance().compare(picture, exact, {{picture.image}}, 1.0).agreement >= kLeastAgreement;
}

std::string nameOf(int quarters, const Eigen::Vector2d& moved) {
  std::string name;
  if (quarters != 0) name = "turned by " + std::to_string(90 * quarters) + " degrees";
  for (const int axis : {0, 1}) {
    if (std::abs(moved(axis)) < kLeastMove) continue;
    name += (name.empty() ? "moved by " : ", moved by ") +
            std::to_string(std::abs(cvRound(100.0 * moved(axis)))) + " % of its " +
            (axis == 0 ? "width" : "height");
  }
  return name;
}

using Outline = std::vector<cv::Point2f>;

/// Returns the number of pairs of `one` whose target point is inside the outline.
std::size_t countInside(const FoundTarget& one, const Outline& outline) {
  const std::vector<Eigen::Vector2d>& points = one.pairs.target;
  return static_cast<std::size_t>(
      std::count_if(points.begin(), points.end(), [&](const Eigen::Vector2d& p) {
        const cv::Point2f point(static_cast<float>(p.x()), static_cast<float>(p.y()));
        return cv::pointPolygonTest(outline, point, false) >= 0.0;
      }));
}

/// Area of the bounding box of the points, px².
double areaOf(const std::vector<Eigen::Vector2d>& points) {
  Eigen::AlignedBox2d box;
  for (const Eigen::Vector2d& p : points) box.extend(p);
  return box.volume();
}

/// Returns true if the points of `one` are spread over most of its picture.
bool coversPicture(const FoundTarget& one, TargetStore& store) {
  // Minimum share of the picture's area that the bounding box of the points covers.
  constexpr double kShare = 0.6;
  return areaOf(one.pairs.reference) > kShare * store.picture(one.picture).image.size().area();
}

Outline outlineOf(const cv::Size& image, const Eigen::Matrix3d& homography) {
  Outline outline;
  for (const Eigen::Vector2d& p : homography::imageCorners(image, {})) {
    const Eigen::Vector2d q = homography::project(homography, p);
    outline.emplace_back(static_cast<float>(q.x()), static_cast<float>(q.y()));
  }
  return outline;
}

Outline outlineOf(const FoundTarget& one, TargetStore& store) {
  return outlineOf(store.picture(one.picture).image.size(), one.estimate.homography);
}

/// Returns true if `one` is much less likely to be a false alarm than `other`. If only a part that
/// both targets have in common is in view, both have nearly the same evidence, so neither is
/// clearly better.
bool isClearlyBetter(const FoundTarget& one, const FoundTarget& other) {
  constexpr double kRatio = 0.8;
  return -other.log_false_alarms < kRatio * -one.log_false_alarms;
}

/// Returns true if `one` looks clearly less like its picture than `around` looks like its own
/// picture. Light and blur do not explain the difference, because they are the same for both.
bool agreesLess(const FoundTarget& one, const FoundTarget& around) {
  constexpr double kRatio = 0.8;
  return one.agreement < kRatio * around.agreement;
}

/// Returns true if the points of `one` are spread over most of the part of its picture that has
/// keypoints.
bool coversTexture(const FoundTarget& one, TargetStore& store) {
  // Minimum area of the bounding box of the points, as a share of the box of all keypoints.
  constexpr double kShare = 0.6;
  const TargetPicture& picture = store.picture(one.picture);
  Eigen::AlignedBox2d all;
  for (std::size_t i = 0; i < picture.own; ++i) {
    const growth::LocalFrame& keypoint = picture.frames.frames()[i];
    all.extend(Eigen::Vector2d(keypoint.x, keypoint.y));
  }
  return areaOf(one.pairs.reference) > kShare * all.volume();
}

/// Returns true if the intersection of the outlines is larger than `share` of the area of the
/// larger outline.
bool areInOnePlace(const Outline& a, const Outline& b, double share) {
  Outline common;
  return cv::intersectConvexConvex(a, b, common) >
         share * std::max(cv::contourArea(a), cv::contourArea(b));
}

// If more than this share of the blocks clearly differs, the image has a part, such as another
// text, that the picture found in it does not have; conflicts() then tells the two apart.
// The limit lies between two measurements: in 350 copies of pictures with other light, scale and
// blur, found in the right place, at most 0.031 of the blocks differ; in different signs that have
// the upper half and one word of the lower half in common, at least 0.041 differ. Glare with a
// sharp edge may change 0.08 of the blocks, so it may be taken for a difference.
constexpr double kShareOfAnotherPart = 0.035;

bool differsInPart(const FoundTarget& found, const cv::Mat& image, TargetStore& store) {
  constexpr double kMostAgreement = 0.9;
  if (found.agreement > kMostAgreement) return false;
  Appearance appearance;
  appearance.compare(store.picture(found.picture), found.estimate.homography, {{image}}, 1.0);
  return appearance.shareThatDiffers() > kShareOfAnotherPart;
}

}  // namespace

std::string ambiguityOf(const TargetPicture& picture) {
  const cv::Size whole = picture.image.size();
  const double scale = std::min(1.0, kCopySide / std::max(whole.width, whole.height));
  const cv::Size size(std::max(8, cvRound(scale * whole.width)),
                      std::max(8, cvRound(scale * whole.height)));
  cv::Mat copy, turned;
  shrink(picture, size, cv::INTER_AREA, copy);
  const Eigen::Matrix3d to_copy = homography::resizing(whole, size);
  for (int quarters = 0; quarters < 4; ++quarters) {
    if (quarters == 0) {
      turned = copy;
    } else {
      cv::rotate(copy, turned, quarters - 1);
    }
    std::vector<cv::Point> shifts = metrics::alikeShifts(turned, copy, kLeastAlike);
    if (shifts.size() > kMostPlaces) shifts.resize(kMostPlaces);
    for (const cv::Point& shift : shifts) {
      Eigen::Matrix3d moving = Eigen::Matrix3d::Identity();
      moving.topRightCorner<2, 1>() << shift.x, shift.y;
      const Eigen::Matrix3d map = to_copy.inverse() * moving * turning(quarters, size) * to_copy;
      const Eigen::Vector2d middle = middleOf(whole);
      const Eigen::Vector2d moved = (homography::project(map, middle) - middle)
                                        .cwiseQuotient(Eigen::Vector2d(whole.width, whole.height));
      if (quarters == 0 && moved.lpNorm<Eigen::Infinity>() < kLeastMove) continue;
      if (looksTheSame(picture, map)) return nameOf(quarters, moved);
    }
  }
  return "";
}

std::vector<std::uint8_t> conflicts(const std::vector<FoundTarget>& found, TargetStore& store) {
  // A target may be part of another target if at least this share of its points is inside the
  // other's outline.
  constexpr double kMost = 0.7;
  // Targets are in the same place if their outlines overlap by more than this share of the larger
  // one.
  constexpr double kSamePlace = 0.5;
  std::vector<std::uint8_t> is_doubtful(found.size(), 0);
  std::vector<Outline> outlines;
  outlines.reserve(found.size());
  for (const FoundTarget& one : found) outlines.push_back(outlineOf(one, store));
  for (std::size_t i = 0; i < found.size(); ++i) {
    for (std::size_t j = 0; j < found.size(); ++j) {
      if (found[j].target == found[i].target) continue;
      if (isClearlyBetter(found[j], found[i])) continue;
      const double inside = static_cast<double>(countInside(found[j], outlines[i]));
      const bool is_part = inside >= kMost * static_cast<double>(found[j].pairs.size()) &&
                           (!coversPicture(found[j], store) || agreesLess(found[j], found[i]));
      if (is_part || areInOnePlace(outlines[i], outlines[j], kSamePlace)) is_doubtful[j] = 1;
    }
  }
  return is_doubtful;
}

bool showsTheSame(const FoundTarget& found, const TargetPicture& picture, TargetStore& store) {
  // Minimum share of blocks that look alike. If two sharp images have only a logo in common, the
  // other blocks differ.
  constexpr double kLeastAgreement = 0.5;
  return found.agreement > kLeastAgreement && coversTexture(found, store) &&
         areInOnePlace(outlineOf(found, store),
                       outlineOf(picture.image.size(), Eigen::Matrix3d::Identity()),
                       kSameOutline) &&
         !differsInPart(found, picture.image, store);
}

bool showTheSame(const TargetPicture& known, const TargetPicture& picture) {
  constexpr double kWorthAligning = 0.2;  // least agreement before the alignment
  // High, because a picture of a few blocks may have most of them in common with another one, such
  // as the frame of a sign, and too few others for shareThatDiffers().
  constexpr double kLeastOfWhole = 0.85;
  const Outline whole = outlineOf(picture.image.size(), Eigen::Matrix3d::Identity());
  Appearance appearance;
  const auto agreement_at = [&](const Eigen::Matrix3d& map) {
    return appearance.compare(known, map, {{picture.image}}, 1.0).agreement;
  };
  for (int quarters = 0; quarters < 4; ++quarters) {
    cv::Size turned = known.image.size();
    if (quarters % 2 == 1) std::swap(turned.width, turned.height);
    const Eigen::Matrix3d start =
        homography::resizing(turned, picture.image.size()) * turning(quarters, known.image.size());
    if (agreement_at(start) < kWorthAligning) continue;
    const Eigen::Matrix3d map = aligned(known, picture.image, start);
    if (areInOnePlace(outlineOf(known.image.size(), map), whole, kSameOutline) &&
        agreement_at(map) >= kLeastOfWhole &&
        appearance.shareThatDiffers() <= kShareOfAnotherPart) {
      return true;
    }
  }
  return false;
}

}  // namespace ktgp_orb::targets
