#include "cli/files.h"

#include <Eigen/LU>
#include <filesystem>
#include <fstream>
#include <opencv2/imgcodecs.hpp>
#include <system_error>
#include <vector>

#include "core/util/grey_levels.h"

namespace ktgp_orb::tools {

using util::stretchTo8Bit;

void requireRegularFile(const std::string& file) {
  std::error_code none;  // an invalid name counts as a missing file
  const std::filesystem::file_status status = std::filesystem::status(file, none);
  if (!std::filesystem::exists(status)) throw FileError(file, "is missing");
  if (!std::filesystem::is_regular_file(status)) throw FileError(file, "is not a regular file");
}

cv::Mat readGrey(const std::string& file) {
  requireRegularFile(file);
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
  constexpr std::size_t kCount = 9;
  std::vector<double> values;
  for (double value = 0.0; values.size() <= kCount && in >> value;) values.push_back(value);
  if (!in.eof() || values.size() != kCount) {
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
