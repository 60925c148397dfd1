#pragma once

#include <Eigen/Core>
#include <opencv2/core.hpp>
#include <stdexcept>
#include <string>

namespace ktgp_orb::files {

/// A file could not be read, parsed or written. The message begins with the name of the file, made
/// printable.
class FileError : public std::runtime_error {
 public:
  FileError(const std::string& file, const std::string& what);
};

/// Throws FileError if the file does not exist or is not a regular file, because reading a pipe or
/// a terminal could block.
void requireRegularFile(const std::string& file);

/// Call this if a file could not be read. Recognises its format by its first bytes and says what
/// the user can do: "is a HEIC picture; convert it ...". Empty for unknown formats.
std::string unreadableFormat(const std::string& file);

/// Describes a file by its first bytes: "is a picture", "is a video", or a format of
/// unreadableFormat(). Empty for other files, and for folders and devices.
std::string knownFormat(const std::string& file);

/// Reads a picture of 8 or 16 bits per channel, decoded with OpenCV's `flags`. All pictures of this
/// package are read with this function. Throws FileError if the picture cannot be read, if a JPEG
/// or PNG is cut off, and for other depths (float, 32 bits), because nobody knows which of their
/// values mean black and white. Fills transparent pixels smoothly from the visible pixels around
/// them, unless `flags` is cv::IMREAD_UNCHANGED.
cv::Mat readPicture(const std::string& file, int flags);

/// Reads a picture as 8-bit grey. 16-bit pictures are stretched to 8 bits as in the nodelet
/// (util::stretchTo8Bit).
cv::Mat readGrey(const std::string& file);

/// Reads a picture for drawing on it: as BGR if the file has 8-bit colours, otherwise as 8-bit
/// grey.
cv::Mat readForView(const std::string& file);

/// Reads a homography from text: nine numbers, row by row, separated by white space (the format of
/// the Oxford and HPatches data). Throws FileError unless there are exactly nine finite numbers
/// that form an invertible matrix. The file may be a pipe.
Eigen::Matrix3d readHomography(const std::string& file);

}  // namespace ktgp_orb::files
