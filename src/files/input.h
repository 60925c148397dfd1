#pragma once

#include <Eigen/Core>
#include <opencv2/core.hpp>
#include <stdexcept>
#include <string>

namespace ktgp_orb::files {

/// A file that cannot be read, parsed or written. The message begins with its name, as far as that
/// can be printed.
class FileError : public std::runtime_error {
 public:
  FileError(const std::string& file, const std::string& what);
};

/// Throws FileError if the file does not exist or is not a regular file: reading a pipe or a
/// terminal could block.
void requireRegularFile(const std::string& file);

/// Kind of a file that the libraries here cannot read, by its first bytes, and the remedy: "is a
/// HEIC picture; convert it ...". Empty if that is not known.
std::string unreadableFormat(const std::string& file);

/// The picture in a file, decoded with OpenCV's `flags`: 8 or 16 bits a channel. Every picture that
/// this package reads passes through here. Throws FileError, also for a JPEG or PNG without its
/// end, and for other depths (float, 32 bits), whose black and white nobody knows. What is hidden
/// under transparent pixels is replaced by a smooth continuation of the rest, unless `flags` are
/// cv::IMREAD_UNCHANGED.
cv::Mat readPicture(const std::string& file, int flags);

/// Reads a picture as 8-bit grey; 16-bit pictures are stretched as in the nodelet.
cv::Mat readGrey(const std::string& file);

/// Reads a picture to be drawn on: 8-bit grey, or blue, green, red where it has colours of 8 bits.
cv::Mat readForView(const std::string& file);

/// A homography as text: nine numbers, row by row, separated by white space (the format of the
/// Oxford and HPatches data). Throws FileError unless there are exactly nine finite numbers that
/// form an invertible matrix. The file may be a pipe.
Eigen::Matrix3d readHomography(const std::string& file);

}  // namespace ktgp_orb::files
