#include "files/input.h"

#include <Eigen/LU>
#include <cstddef>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <opencv2/imgcodecs.hpp>
#include <system_error>
#include <vector>

#include "util/grey_levels.h"
#include "util/printable.h"

namespace ktgp_orb::files {
namespace {

constexpr char kJpeg[] = "\xFF\xD8\xFF";
constexpr char kPng[] = "\x89PNG\r\n\x1A\n";

/// Big-endian; zero beyond the end.
std::size_t numberAt(std::size_t position, std::size_t size, const std::string& bytes) {
  std::size_t number = 0;
  for (std::size_t i = position; i < position + size && i < bytes.size(); ++i) {
    number = number << 8U | static_cast<unsigned char>(bytes[i]);
  }
  return number;
}

/// Segments of a marker, a length that counts itself, and data, with compressed pixels between
/// them, where FF is followed by 0 or by the number of a restart. A preview is in a segment.
bool jpegEnds(const std::string& bytes) {
  constexpr std::size_t kEnd = 0xD9;
  std::size_t position = 2;
  while ((position = bytes.find('\xFF', position)) != std::string::npos) {
    const std::size_t marker = numberAt(++position, 1, bytes);
    if (marker == kEnd) return true;
    if (marker == 0xFF) continue;  // filling
    ++position;
    const bool is_alone = marker <= 1 || (marker >= 0xD0 && marker <= 0xD7);
    if (!is_alone) position += numberAt(position, 2, bytes);
  }
  return false;
}

/// Chunks of a length, a name, data and a checksum.
bool pngEnds(const std::string& bytes) {
  std::size_t position = sizeof kPng - 1;
  while (position + 8 <= bytes.size()) {
    if (bytes.compare(position + 4, 4, "IEND") == 0) return true;
    position += 12 + numberAt(position, 4, bytes);
  }
  return false;
}

/// Whether the file is a JPEG or PNG without its end. Libraries decode such a JPEG with grey in
/// place of what is missing, and print what they think of it. Bytes after the end do not matter.
bool isCutOff(const std::string& file) {
  std::ifstream in(file, std::ios::binary);
  std::string bytes(sizeof kPng - 1, '\0');
  in.read(bytes.data(), static_cast<std::streamsize>(bytes.size()));
  const bool jpeg = bytes.compare(0, sizeof kJpeg - 1, kJpeg) == 0;
  const bool png = bytes == kPng;
  if (!in || (!jpeg && !png)) return false;
  bytes.append(std::istreambuf_iterator<char>(in), {});
  return jpeg ? !jpegEnds(bytes) : !pngEnds(bytes);
}

/// 8 or 16 bits a channel.
bool isUsual(const cv::Mat& picture) {
  return picture.depth() == CV_8U || picture.depth() == CV_16U;
}

}  // namespace

FileError::FileError(const std::string& file, const std::string& what)
    : std::runtime_error(util::printable(file) + ": " + what) {}

void requireRegularFile(const std::string& file) {
  std::error_code none;  // an invalid name counts as a missing file
  const std::filesystem::file_status status = std::filesystem::status(file, none);
  if (!std::filesystem::exists(status)) throw FileError(file, "is missing");
  if (!std::filesystem::is_regular_file(status)) throw FileError(file, "is not a regular file");
}

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
