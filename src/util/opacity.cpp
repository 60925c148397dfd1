#include "util/opacity.h"

#include <opencv2/imgproc.hpp>

namespace ktgp_orb::util {
namespace {

/// Fills the unknown values of a picture. `weight`: CV_32FC1, 1 where `values` are known and 0
/// elsewhere. Makes a picture of half the size, in which each pixel is the mean of the known values
/// that it covers, fills that picture in the same way, and interpolates the unknown values from it.
void fill(const cv::Mat& weight, cv::Mat& values) {
  if (cv::countNonZero(weight) == static_cast<int>(weight.total())) return;
  const cv::Size half((weight.cols + 1) / 2, (weight.rows + 1) / 2);
  cv::Mat share, sum;
  cv::resize(weight, share, half, 0, 0, cv::INTER_AREA);
  cv::resize(values, sum, half, 0, 0, cv::INTER_AREA);
  const cv::Mat known = share > 0.0F;
  share.setTo(1.0F, ~known);
  cv::Mat shares[4] = {share, share, share, share};
  cv::Mat divisor;
  cv::merge(shares, static_cast<std::size_t>(values.channels()), divisor);
  cv::divide(sum, divisor, sum);
  cv::Mat known_share;
  known.convertTo(known_share, CV_32F, 1.0 / 255.0);
  fill(known_share, sum);
  cv::Mat smooth;
  cv::resize(sum, smooth, values.size(), 0, 0, cv::INTER_LINEAR);
  smooth.copyTo(values, weight == 0.0F);
}

}  // namespace

cv::Mat visiblePart(const cv::Mat& picture) {
  if (picture.channels() != 4) return {};
  cv::Mat opacity;
  cv::extractChannel(picture, opacity, 3);
  const cv::Mat visible = opacity >= (picture.depth() == CV_8U ? 128.0 : 32768.0);
  const int count = cv::countNonZero(visible);
  return count == 0 || count == static_cast<int>(visible.total()) ? cv::Mat() : visible;
}

void fillHidden(const cv::Mat& visible, cv::Mat& picture) {
  if (visible.empty()) return;
  cv::Mat weight, values;
  visible.convertTo(weight, CV_32F, 1.0 / 255.0);
  picture.convertTo(values, CV_32F);
  values.setTo(cv::Scalar::all(0.0), visible == 0);
  fill(weight, values);
  values.convertTo(picture, picture.depth());
}

}  // namespace ktgp_orb::util
