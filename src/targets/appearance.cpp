#include "targets/appearance.h"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <limits>
#include <opencv2/imgproc.hpp>

#include "homography/transform.h"

namespace ktgp_orb::targets {
namespace {

constexpr int kSide = 8;         // side of a block, px
constexpr int kMostBlocks = 16;  // largest number of blocks along a side of the picture
constexpr float kAlike = 0.7F;   // two blocks with a larger correlation look alike
constexpr int kDecoyReach = 2;   // largest shift of a decoy (see agreementOfDecoys()), in blocks

/// Returns log10 of Chernoff's upper bound for the probability of at least `hits` hits in `count`
/// trials, each of which hits with the probability `chance`.
double logTail(double hits, double count, double chance) {
  const double share = hits / count;
  if (share <= chance) return 0.0;
  double divergence = share * std::log(share / chance);
  if (share < 1.0) divergence += (1.0 - share) * std::log((1.0 - share) / (1.0 - chance));
  return -count * divergence / std::log(10.0);
}

/// Returns the number of blocks along a side of the picture. `length`: length of this side in the
/// frame, px. `enlargement`: see FramePyramid. A block covers at least 4 px of the camera image,
/// because neighbouring pixels of an enlarged frame are interpolated and therefore not independent.
int blocksAlong(double length, double enlargement) {
  constexpr double kLeastTaken = 4.0;  // minimum side of a block, px of the camera image
  const double side = std::max<double>(kSide, kLeastTaken * enlargement);
  return std::clamp(static_cast<int>(length / side), 3, kMostBlocks);
}

/// Returns the dot product of two blocks. Adds up sixteen partial sums, so that the compiler can
/// use vector instructions. It cannot do so for a single sum, because it must not change the order
/// of the additions.
float productOf(const float (&a)[kSide * kSide], const float (&b)[kSide * kSide]) {
  constexpr int kColumns = 16;
  float sums[kColumns] = {};
  for (int i = 0; i < kSide * kSide; i += kColumns) {
    for (int k = 0; k < kColumns; ++k) sums[k] += a[i + k] * b[i + k];
  }
  float total = 0.F;
  for (const float sum : sums) total += sum;
  return total;
}

cv::Matx33d matrixOf(const Eigen::Matrix3d& m) {
  return {m(0, 0), m(0, 1), m(0, 2), m(1, 0), m(1, 1), m(1, 2), m(2, 0), m(2, 1), m(2, 2)};
}

}  // namespace

/// Resizes the picture to `size` and stores it in picture_. Warps the part of the frame that shows
/// the picture to the same size, with a margin on each side, and stores it in frame_.
void Appearance::sample(const TargetPicture& picture, const Eigen::Matrix3d& homography,
                        const cv::Size& size, const cv::Size& margin, const FramePyramid& frame) {
  const cv::Size& whole = picture.image.size();
  const cv::Size2d seen = sizeIn(homography, whole);
  shrink(picture, size, cv::INTER_LINEAR, picture_);
  Eigen::Matrix3d to_picture = homography::resizing(size, whole);
  to_picture.col(2) -= to_picture.leftCols<2>() * Eigen::Vector2d(margin.width, margin.height);
  const double finer = std::min(seen.width / size.width, seen.height / size.height);
  const auto finest = static_cast<std::size_t>(
      std::max(0.0, std::floor(std::log(std::max(finer, 1.0)) / std::log(frame.scale_factor))));
  const cv::Mat& level = frame.levels[std::min(finest, frame.levels.size() - 1)];
  const Eigen::Matrix3d to_level = homography::resizing(frame.levels[0].size(), level.size());
  cv::warpPerspective(level, frame_, matrixOf(to_level * homography * to_picture),
                      size + margin + margin, cv::INTER_LINEAR | cv::WARP_INVERSE_MAP,
                      cv::BORDER_CONSTANT, 0);
}

bool Appearance::locate(const TargetPicture& picture, const Eigen::Matrix3d& homography,
                        const FramePyramid& frame, double radius, Eigen::Matrix3d& located) {
  // Longer side of the resized picture, px. A larger picture takes longer but gives the same
  // position.
  constexpr double kLongest = 48.0;
  constexpr double kLeastAlike = 0.4;  // minimum correlation; low, because compare() is stricter
  const cv::Size2d seen = sizeIn(homography, picture.image.size());
  const double scale = std::min(1.0, kLongest / std::max(seen.width, seen.height));
  const cv::Size size(std::max(kSide, cvRound(scale * seen.width)),
                      std::max(kSide, cvRound(scale * seen.height)));
  const int reach = std::max(1, cvRound(scale * radius));
  sample(picture, homography, size, {reach, reach}, frame);
  cv::Mat correlation;
  cv::matchTemplate(frame_, picture_, correlation, cv::TM_CCOEFF_NORMED);
  double best = 0.0;
  cv::Point place;
  cv::minMaxLoc(correlation, nullptr, &best, nullptr, &place);
  if (!(best > kLeastAlike)) return false;
  const Eigen::Matrix3d to_picture = homography::resizing(size, picture.image.size());
  Eigen::Matrix3d shift = Eigen::Matrix3d::Identity();
  shift.topRightCorner<2, 1>() =
      to_picture.topLeftCorner<2, 2>() * Eigen::Vector2d(place.x - reach, place.y - reach);
  located = homography * shift;
  return homography::scaleLastToOne(located);
}

void Appearance::cut(const cv::Mat& image, float least_deviation,
                     std::vector<Block>& blocks) const {
  blocks.resize(static_cast<std::size_t>(columns_) * static_cast<std::size_t>(rows_));
  std::size_t number = 0;
  for (int row = 0; row < rows_; ++row) {
    for (int column = 0; column < columns_; ++column) {
      Block& block = blocks[number++];
      float sum = 0.F;
      std::size_t i = 0;
      for (int y = 0; y < kSide; ++y) {
        const auto* line = image.ptr<std::uint8_t>(row * kSide + y, column * kSide);
        for (int x = 0; x < kSide; ++x) {
          block.values[i++] = line[x];
          sum += line[x];
        }
      }
      const float mean = sum / (kSide * kSide);
      float squares = 0.F;
      for (float& value : block.values) {
        value -= mean;
        squares += value * value;
      }
      const float length = std::sqrt(squares);
      block.has_texture = length > least_deviation * kSide;
      for (float& value : block.values) value /= std::max(length, 1e-3F);
    }
  }
}

/// Marks the blocks whose centre is in the frame.
void Appearance::markSeen(const Eigen::Matrix3d& homography, const cv::Size& picture,
                          const cv::Size& frame) {
  std::size_t number = 0;
  for (int row = 0; row < rows_; ++row) {
    for (int column = 0; column < columns_; ++column) {
      const Eigen::Vector2d p =
          homography::project(homography, {(column + 0.5) * picture.width / columns_ - 0.5,
                                           (row + 0.5) * picture.height / rows_ - 0.5});
      of_frame_[number++].is_seen =
          p.x() >= 0.0 && p.y() >= 0.0 && p.x() <= frame.width - 1.0 && p.y() <= frame.height - 1.0;
    }
  }
}

Appearance::Agreement Appearance::agreementAt(int dx, int dy) const {
  Agreement agreement;
  for (int y = std::max(0, -dy); y < std::min(rows_, rows_ - dy); ++y) {
    for (int x = std::max(0, -dx); x < std::min(columns_, columns_ - dx); ++x) {
      const Block& a = of_picture_[blockAt(x, y)];
      const Block& b = of_frame_[blockAt(x + dx, y + dy)];
      if (!a.has_texture || !b.is_seen) continue;
      agreement.pairs += 1.0;
      if (b.has_texture && productOf(a.values, b.values) > kAlike) agreement.hits += 1.0;
    }
  }
  return agreement;
}

/// Compares the picture with the frame at decoy positions: shifted by up to kDecoyReach blocks, so
/// that all hits are chance hits. Returns the sum of the hits and of the pairs over all decoy
/// positions, plus one hit in one pair, so that the rate of chance hits is never 0. Raises
/// `largest` to the highest share of hits at any decoy position with at least `fewest` pairs of
/// blocks.
Appearance::Agreement Appearance::agreementOfDecoys(double fewest, double& largest) const {
  Agreement decoys{1.0, 1.0};
  for (int dy = -kDecoyReach; dy <= kDecoyReach; ++dy) {
    for (int dx = -kDecoyReach; dx <= kDecoyReach; ++dx) {
      if (dx == 0 && dy == 0) continue;
      const Agreement here = agreementAt(dx, dy);
      decoys.hits += here.hits;
      decoys.pairs += here.pairs;
      if (here.pairs >= fewest) largest = std::max(largest, here.hits / here.pairs);
    }
  }
  return decoys;
}

Appearance::Similarity Appearance::compare(const TargetPicture& picture,
                                           const Eigen::Matrix3d& homography,
                                           const FramePyramid& frame, double tests,
                                           double above_neighbours) {
  // A block of the picture or of the frame has texture if the standard deviation of its grey values
  // is larger than this.
  constexpr float kPictureDeviation = 6.F, kFrameDeviation = 3.F;
  constexpr double kFewest = 6.0;
  constexpr double kFewestToDiffer = 12.0;
  // At least this share of the blocks in view must look alike; the other blocks may be hidden.
  constexpr double kLeastShare = 0.3;
  // We warp the picture and the frame to the same size: at most the size of the picture in the
  // frame, but at least three blocks per side.
  const cv::Size2d seen = sizeIn(homography, picture.image.size());
  columns_ = blocksAlong(seen.width, frame.enlargement);
  rows_ = blocksAlong(seen.height, frame.enlargement);
  sample(picture, homography, {columns_ * kSide, rows_ * kSide}, {0, 0}, frame);
  cut(picture_, kPictureDeviation, of_picture_);
  cut(frame_, kFrameDeviation, of_frame_);
  markSeen(homography, picture.image.size(), frame.levels[0].size());

  const Agreement own = agreementAt(0, 0);
  double largest = 0.0;  // largest share of hits among the decoy positions
  const Agreement decoys = agreementOfDecoys(kFewest, largest);
  Similarity similarity;
  similarity.agreement = own.hits / std::max(own.pairs, 1.0);
  similarity.differs = own.pairs >= kFewestToDiffer && similarity.agreement < kLeastShare;
  const double least_share = std::max(kLeastShare, above_neighbours * largest);
  if (own.hits < kFewest || similarity.agreement < least_share) {
    similarity.log_false_alarms = std::numeric_limits<double>::infinity();
    return similarity;
  }
  similarity.log_false_alarms =
      std::log10(tests) + logTail(own.hits, own.pairs, std::min(decoys.hits / decoys.pairs, 0.999));
  return similarity;
}

double Appearance::shareThatDiffers() const {
  // Two blocks with a smaller correlation differ. Blur alone leaves a larger correlation.
  constexpr float kUnlike = 0.2F;
  // The number of differing blocks is divided by at least this number of blocks. Otherwise, in a
  // small picture, a few blocks that differ by chance would give a large share.
  constexpr double kFewest = 100.0;
  double all = 0.0, unlike = 0.0;
  for (int row = 1; row + 1 < rows_; ++row) {
    for (int column = 1; column + 1 < columns_; ++column) {
      const Block& a = of_picture_[blockAt(column, row)];
      const Block& b = of_frame_[blockAt(column, row)];
      if (!a.has_texture || !b.has_texture || !b.is_seen) continue;
      all += 1.0;
      if (productOf(a.values, b.values) < kUnlike) unlike += 1.0;
    }
  }
  return unlike / std::max(all, kFewest);
}

}  // namespace ktgp_orb::targets
