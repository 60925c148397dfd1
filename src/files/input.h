#pragma once

#include <Eigen/Core>
#include <opencv2/core.hpp>
#include <stdexcept>
#include <string>

namespace ktgp_orb::files {

/// A file that cannot be read, parsed or written. The message begins with the printable file name.
class FileError : public std::runtime_error {
 public:
  FileError(const std::string& file, const std::string& what);
};

/// Throws FileError if the file does not exist or is not a regular file: reading a pipe or a
/// terminal could block.
void requireRegularFile(const std::string& file);

/// Looks at the first bytes of a file that the libraries here cannot read. Returns the kind of the
/// file and the remedy: "is a HEIC picture; convert it ...". Empty if the kind is unknown.
std::string unreadableFormat(const std::string& file);

/// Reads a picture of 8 or 16 bits per channel, decoded with OpenCV's `flags`. The package reads
/// every picture with this function. Throws FileError, also for a JPEG or PNG that is cut off. Also
/// refuses other depths (float, 32 bits), because it is unknown which values mean black and white.
/// Transparent pixels are filled with a smooth continuation of the visible pixels, unless `flags`
/// is cv::IMREAD_UNCHANGED.
cv::Mat readPicture(const std::string& file, int flags);

/// Reads a picture as 8-bit grey; 16-bit pictures are converted as in the nodelet
/// (util::stretchTo8Bit).
cv::Mat readGrey(const std::string& file);

/// Reads a picture for drawing on it: BGR if the file has 8-bit colours, else 8-bit grey.
cv::Mat readForView(const std::string& file);

/// Reads a homography from text: nine numbers, row by row, separated by white space (the format of
/// the Oxford and HPatches data). Throws FileError unless there are exactly nine finite numbers
/// that form an invertible matrix. The file may be a pipe.
Eigen::Matrix3d readHomography(const std::string& file);

}  // namespace ktgp_orb::files
