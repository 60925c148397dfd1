#include <stdexcept>
#include <string>

#include "ktgp_orb/opencv.h"

namespace ktgp_orb {
namespace {

/// The points of any matrix or vector that cv::findHomography takes.
std::vector<Eigen::Vector2d> pointsOf(cv::InputArray array, const std::string& name) {
  const cv::Mat points = array.getMat();
  const int count = points.empty() ? 0 : points.checkVector(2, -1, false);
  if (count < 0) {
    throw std::invalid_argument(name + " points are " + cv::typeToString(points.type()) + ", " +
                                std::to_string(points.cols) + "x" + std::to_string(points.rows) +
                                "; expected two coordinates per point");
  }
  std::vector<Eigen::Vector2d> result;
  if (count == 0) return result;
  cv::Mat values;
  points.convertTo(values, CV_64F);  // now without gaps between the rows
  values = values.reshape(1, count);
  result.reserve(static_cast<std::size_t>(count));
  for (int i = 0; i < count; ++i) {
    result.emplace_back(values.at<double>(i, 0), values.at<double>(i, 1));
  }
  return result;
}

std::vector<double> noisesOf(cv::InputArray array) {
  const cv::Mat noises = array.getMat();
  const int count = noises.empty() ? 0 : noises.checkVector(1, -1, false);
  if (count < 0) {
    throw std::invalid_argument("noises are " + cv::typeToString(noises.type()) + ", " +
                                std::to_string(noises.cols) + "x" + std::to_string(noises.rows) +
                                "; expected one value per point");
  }
  std::vector<double> result;
  cv::Mat values;
  noises.convertTo(values, CV_64F);
  result.reserve(noises.total());
  for (int i = 0; i < count; ++i) result.push_back(values.at<double>(i));
  return result;
}

ProsacResult estimate(const PointPairs& pairs, const ProsacOptions& options,
                      const cv::Size& reference_size) {
  ProsacResult result;
  ProsacHomography(options).estimate(pairs, reference_size, result);
  return result;
}

void requireEqual(std::size_t reference, std::size_t target) {
  if (reference == target) return;
  throw std::invalid_argument("there are " + std::to_string(reference) + " reference points and " +
                              std::to_string(target) + " target points; expected equal numbers");
}

PointPairs pairsOf(cv::InputArray reference, cv::InputArray target) {
  PointPairs pairs;
  pairs.reference = pointsOf(reference, "reference");
  pairs.target = pointsOf(target, "target");
  requireEqual(pairs.reference.size(), pairs.target.size());
  return pairs;
}

}  // namespace

ProsacResult estimateHomography(cv::InputArray reference, cv::InputArray target,
                                const ProsacOptions& options, const cv::Size& reference_size) {
  PointPairs pairs = pairsOf(reference, target);
  pairs.quality.assign(pairs.size(), 0.0);  // equal ones keep their order
  return estimate(pairs, options, reference_size);
}

ProsacResult estimateHomography(cv::InputArray reference, cv::InputArray target,
                                cv::InputArray noise, const ProsacOptions& options,
                                const cv::Size& reference_size) {
  PointPairs pairs = pairsOf(reference, target);
  pairs.noise = noisesOf(noise);
  if (pairs.noise.size() != pairs.size()) {
    throw std::invalid_argument("there are " + std::to_string(pairs.noise.size()) + " noises and " +
                                std::to_string(pairs.size()) +
                                " point pairs; expected one per pair");
  }
  pairs.quality = pairs.noise;
  return estimate(pairs, options, reference_size);
}

}  // namespace ktgp_orb
