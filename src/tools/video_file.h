#pragma once

#include <opencv2/core.hpp>
#include <opencv2/videoio.hpp>
#include <string>

#include "files/output_file.h"

namespace ktgp_orb::tools {

class VideoFile {
 public:
  /// `rate`: frames per second. `outputs` must outlive this object. Throws FileError if the file
  /// cannot be written.
  VideoFile(const std::string& path, double rate, files::Outputs& outputs);

  /// Adds a frame of type CV_8UC3 or CV_8UC1; the first frame sets the size of the video, and the
  /// other frames are scaled to this size. Throws FileError if this OpenCV cannot write mp4.
  void write(const cv::Mat& frame);
  bool empty() const { return !writer_.isOpened(); }
  /// Completes the file. Throws FileError if this fails or if no frame was written.
  void close();

 private:
  void open(const cv::Size& size);

  std::string path_;
  double rate_;
  files::Outputs& outputs_;
  files::OutputFile& file_;
  cv::VideoWriter writer_;
  cv::Size size_;
  double frames_ = 0.0;  // frames written
};

}  // namespace ktgp_orb::tools
