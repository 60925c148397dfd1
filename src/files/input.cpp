#include "files/input.h"

#include <Eigen/LU>
#include <filesystem>
#include <fstream>
#include <opencv2/imgcodecs.hpp>
#include <system_error>
#include <vector>

#include "core/util/grey_levels.h"
#include "core/util/printable.h"
#include "files/picture_end.h"

namespace ktgp_orb::files {

FileError::FileError(const std::string& file, const std::string& what)
    : std::runtime_error(util::printable(file) + ": " + what) {}

void requireRegularFile(const std::string& file) {
  std::error_code none;  // an invalid name counts as a missing file
  const std::filesystem::file_status status = std::filesystem::status(file, none);
  if (!std::filesystem::exists(status)) throw FileError(file, "is missing");
  if (!std::filesystem::is_regular_file(status)) throw FileError(file, "is not a regular file");
}

namespace {

/// 8 or 16 bits a channel.
bool isUsual(const cv::Mat& picture) {
  return picture.depth() == CV_8U || picture.depth() == CV_16U;
}

}  // namespace

cv::Mat readPicture(const std::string& file, int flags) {
  requireRegularFile(file);
  if (!std::ifstream(file)) throw FileError(file, "cannot be opened");
  if (isCutOff(file)) {
    throw FileError(file, "is damaged or cut off: the picture has no end; expected a whole file");
  }
  cv::Mat picture;
  try {
    picture = cv::imread(file, flags);
    // Some pictures of floats cannot be converted, and are named below.
    if (picture.empty()) {
      const cv::Mat as_it_is = cv::imread(file, cv::IMREAD_UNCHANGED);
      if (!isUsual(as_it_is)) picture = as_it_is;
    }
  } catch (const cv::Exception& error) {
    throw FileError(file, "cannot be read as an image (" + error.err + ")");
  }
  if (picture.empty()) throw FileError(file, "cannot be read as an image");
  if (!isUsual(picture)) {
    throw FileError(file, std::string("has ") + cv::depthToString(picture.depth()) +
                              " pixels; expected a picture of 8 or 16 bits a channel");
  }
  return picture;
}

cv::Mat readGrey(const std::string& file) {
  const cv::Mat picture = readPicture(file, cv::IMREAD_GRAYSCALE | cv::IMREAD_ANYDEPTH);
  return picture.depth() == CV_16U ? util::stretchTo8Bit(picture) : picture;
}

cv::Mat readForView(const std::string& file) {
  const cv::Mat picture = readPicture(file, cv::IMREAD_ANYCOLOR | cv::IMREAD_ANYDEPTH);
  return picture.depth() == CV_16U ? readGrey(file) : picture;
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

}  // namespace ktgp_orb::files
