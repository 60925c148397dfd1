#include "files/input.h"

#include <Eigen/LU>
#include <algorithm>
#include <cstddef>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <opencv2/imgcodecs.hpp>
#include <system_error>
#include <vector>

#include "files/jpeg_data.h"
#include "files/picture_bytes.h"
#include "util/grey_levels.h"
#include "util/opacity.h"
#include "util/printable.h"

namespace ktgp_orb::files {
namespace {

/// The first `most` bytes of a file, or all bytes if the file is shorter.
std::string firstBytes(const std::string& file, std::size_t most) {
  std::ifstream in(file, std::ios::binary);
  std::string bytes(most, '\0');
  in.read(bytes.data(), static_cast<std::streamsize>(most));
  bytes.resize(static_cast<std::size_t>(std::max<std::streamsize>(in.gcount(), 0)));
  return bytes;
}

/// Reads a whole JPEG or PNG, so that it can be checked for damage; empty for other files.
std::string checkedBytes(const std::string& file) {
  if (!isCutOff(firstBytes(file, 8))) return {};  // neither a JPEG nor a PNG
  std::ifstream in(file, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), {}};
}

constexpr char kPicture[] = "is a picture";
constexpr char kVideo[] =
    "is a video; ktgp_bag matches a video that is given alone, and finds targets in it with "
    "--targets";
constexpr char kHeic[] =
    "is a HEIC (HEIF) picture, as telephones take; convert it to JPEG, for example with "
    "heif-convert";
constexpr char kJpegXl[] = "is a JPEG XL picture; convert it to PNG, for example with djxl";
constexpr char kCameraRaw[] = "is a raw picture of a camera; develop it as PNG or TIFF";
constexpr char kRos2[] = "is a recording of ROS 2; convert it to a bag with rosbags-convert";

/// A file format, recognised by the `bytes` at position `at` of the file.
struct KnownFormat {
  std::size_t at;
  std::string_view bytes;
  const char* what;
};

constexpr KnownFormat kKnownFormats[] = {
    {4, "ftypheic", kHeic},
    {4, "ftypheix", kHeic},
    {4, "ftyphevc", kHeic},
    {4, "ftypmif1", kHeic},
    {4, "ftypmsf1", kHeic},
    {4, "ftypavif", "is an AVIF picture; convert it to PNG, for example with avifdec"},
    {4, "JXL ", kJpegXl},
    {0, "\xFF\x0A", kJpegXl},
    {4, "ftypcrx", kCameraRaw},
    {8, "CR\x02", kCameraRaw},
    {0, "GIF8", "is a GIF; convert it to PNG, or to a video, for example with ffmpeg"},
    {0, "%PDF", "is a PDF document; draw its pages as PNG, for example with pdftoppm"},
    {0, "<svg", "is an SVG drawing; draw it as PNG, for example with rsvg-convert"},
    {0, "version https://git-lfs", "is a pointer of Git LFS; fetch the file with git lfs pull"},
    {0, "\x89MCAP0", kRos2},
    {0, "SQLite format 3", kRos2},
    {0, "#ROSBAG V2", "is a bag of ROS 1; ktgp_bag matches bags"},
    {0, "#ROSBAG V1", "is a bag of format 1; convert it with 'rosbag fix'"},
    {0, "\x1F\x8B", "is packed with gzip; unpack it"},
    {0, "BZh", "is packed with bzip2; unpack it"},
    {0, "\x28\xB5\x2F\xFD", "is packed with zstd; unpack it"},
    {0, "PK\x03\x04", "is packed with zip; unpack it"},
};

/// Returns true if the file begins like an MP4, QuickTime, Matroska or AVI video.
bool isVideo(const std::string& file) {
  std::string begin = firstBytes(file, 12);
  begin.resize(12);
  for (const char* brand : {"ftypiso", "ftypmp4", "ftypavc1", "ftypqt  ", "ftypM4V", "ftyp3gp"}) {
    if (begin.compare(4, std::strlen(brand), brand) == 0) return true;
  }
  return begin.compare(0, 4, "\x1A\x45\xDF\xA3") == 0 || begin.compare(8, 4, "AVI ") == 0;
}

/// Replaces the values of transparent pixels: they are arbitrary, because nobody sees them.
void hideTransparent(const std::string& file, cv::Mat& picture) {
  const cv::Mat whole = cv::imread(file, cv::IMREAD_UNCHANGED);
  cv::Mat opacity;
  if (whole.channels() == 4) cv::extractChannel(whole, opacity, 3);
  if (!opacity.empty() && cv::countNonZero(opacity) == 0) {
    throw FileError(file, "is transparent everywhere; expected a picture that can be seen");
  }
  const cv::Mat visible = util::visiblePart(whole);
  if (!visible.empty() && visible.size() != picture.size()) {
    throw FileError(file, "has transparent pixels and is stored turned; expected it upright");
  }
  util::fillHidden(visible, picture);
}

/// Returns true if the picture has 8 or 16 bits per channel.
bool isUsual(const cv::Mat& picture) {
  return picture.depth() == CV_8U || picture.depth() == CV_16U;
}

}  // namespace

FileError::FileError(const std::string& file, const std::string& what)
    : std::runtime_error(util::printable(file) + ": " + what) {}

std::string unreadableFormat(const std::string& file) {
  std::error_code none;
  if (std::filesystem::is_directory(file, none)) {
    const bool is_bag =
        std::filesystem::exists(std::filesystem::path(file) / "metadata.yaml", none);
    return is_bag ? kRos2 : "is a folder; expected a file, or a pattern of images: 'folder/*.png'";
  }
  const std::string begin = firstBytes(file, 64);
  for (const KnownFormat& format : kKnownFormats) {
    if (begin.size() > format.at &&
        begin.compare(format.at, format.bytes.size(), format.bytes) == 0) {
      return format.what;
    }
  }
  return {};
}

std::string knownFormat(const std::string& file) {
  std::error_code none;
  if (!std::filesystem::is_regular_file(file, none)) return {};
  if (isVideo(file)) return kVideo;
  const std::string known = unreadableFormat(file);
  return known.empty() && cv::haveImageReader(file) ? kPicture : known;
}

void requireRegularFile(const std::string& file) {
  std::error_code none;  // ignored: an invalid name counts as a missing file
  const std::filesystem::file_status status = std::filesystem::status(file, none);
  if (!std::filesystem::exists(status)) throw FileError(file, "is missing");
  if (!std::filesystem::is_regular_file(status)) throw FileError(file, "is not a regular file");
}

cv::Mat readPicture(const std::string& file, int flags) {
  requireRegularFile(file);
  if (!std::ifstream(file)) throw FileError(file, "cannot be opened");
  const std::string bytes = checkedBytes(file);
  if (isCutOff(bytes)) {
    throw FileError(file, "is damaged or cut off: the picture has no end; expected a whole file");
  }
  cv::Mat picture;
  try {
    picture = cv::imread(file, flags);
    // OpenCV cannot convert some floating-point pictures. Read such a picture unchanged, so that
    // the check below can refuse it because of its depth.
    if (picture.empty()) {
      const cv::Mat as_it_is = cv::imread(file, cv::IMREAD_UNCHANGED);
      if (!isUsual(as_it_is)) picture = as_it_is;
    }
  } catch (const cv::Exception& error) {
    throw FileError(file, "cannot be read as an image (" + error.err + ")");
  }
  if (picture.empty()) {
    const std::string known = knownFormat(file);
    const bool says_why = !known.empty() && known != kPicture;
    throw FileError(file, "cannot be read as an image" + (says_why ? ": it " + known : ""));
  }
  if (!isUsual(picture)) {
    throw FileError(file, std::string("has ") + cv::depthToString(picture.depth()) +
                              " pixels; expected a picture of 8 or 16 bits a channel");
  }
  if (lacksData(bytes, picture)) {
    throw FileError(file,
                    "is damaged: data of the picture are missing, and it is grey there; "
                    "expected a whole file");
  }
  if (flags != cv::IMREAD_UNCHANGED && mayBeTransparent(bytes)) hideTransparent(file, picture);
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
