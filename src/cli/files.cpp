#include "cli/files.h"

#include <Eigen/LU>
#include <fstream>
#include <opencv2/imgcodecs.hpp>
#include <vector>

#include "core/util/grey_levels.h"

namespace ktgp_orb::tools {

cv::Mat readGrey(const std::string& file) {
  if (!std::ifstream(file)) throw FileError(file, "cannot be opened");
  cv::Mat image;
  try {
    image = cv::imread(file, cv::IMREAD_GRAYSCALE | cv::IMREAD_ANYDEPTH);
  } catch (const cv::Exception& error) {
    throw FileError(file, "cannot be read as an image (" + error.err + ")");
  }
  if (image.empty()) throw FileError(file, "cannot be read as an image");
  if (image.depth() == CV_16U) return stretchTo8Bit(image);
  if (image.depth() != CV_8U) throw FileError(file, "has neither 8 nor 16 bits");
  return image;
}

Eigen::Matrix3d readHomography(const std::string& file) {
  std::ifstream in(file);
  if (!in) throw FileError(file, "cannot be opened");
  std::vector<double> values;
  for (double value = 0.0; in >> value;) values.push_back(value);
  if (!in.eof() || values.size() != 9) {
    throw FileError(file, "is not a homography; expected nine numbers, row by row");
  }
  using RowMajor = Eigen::Matrix<double, 3, 3, Eigen::RowMajor>;
  Eigen::Matrix3d homography = Eigen::Map<const RowMajor>(values.data());
  if (!homography.allFinite() || homography.determinant() == 0.0) {
    throw FileError(file, "is not a homography: the matrix cannot be inverted");
  }
  return homography;
}

}  // namespace ktgp_orb::tools
