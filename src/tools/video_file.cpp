#include "tools/video_file.h"

#include <opencv2/imgproc.hpp>

#include "files/input.h"

namespace ktgp_orb::tools {

VideoFile::VideoFile(const std::string& path, double rate, files::Outputs& outputs)
    : path_(path), rate_(rate), outputs_(outputs), file_(outputs.add(path)) {}

// Uses H.264 if this OpenCV has an encoder for it, because browsers do not play MPEG-4. H.264 needs
// an even width and height.
void VideoFile::open(const cv::Size& size) {
  size_ = cv::Size(size.width / 2 * 2, size.height / 2 * 2);
  for (const char* codec : {"avc1", "mp4v"}) {
    const int code = cv::VideoWriter::fourcc(codec[0], codec[1], codec[2], codec[3]);
    for (const int backend : {cv::CAP_FFMPEG, cv::CAP_GSTREAMER}) {
      if (writer_.open(file_.unfinished(), backend, code, rate_, size_)) return;
    }
  }
  throw files::FileError(path_,
                         "OpenCV of this machine cannot write mp4; expected a build with FFmpeg or "
                         "GStreamer, as Debian's and Ubuntu's are");
}

void VideoFile::write(const cv::Mat& frame) {
  if (empty()) open(frame.size());
  cv::Mat colour = frame;
  if (frame.channels() == 1) cv::cvtColor(frame, colour, cv::COLOR_GRAY2BGR);
  if (colour.size() != size_) {
    cv::resize(colour, colour, size_, 0, 0, cv::INTER_AREA);
  }
  writer_.write(colour);
  ++frames_;
}

void VideoFile::close() {
  if (empty()) throw files::FileError(path_, "is not written: there was no frame");
  writer_.release();
  // cv::VideoWriter does not report that the disk is full, so check that the file contains all
  // frames.
  const cv::VideoCapture written(file_.unfinished());
  if (!written.isOpened() || written.get(cv::CAP_PROP_FRAME_COUNT) < frames_) {
    files::throwUnwritable(file_, "the video lacks frames; expected more space on the disk");
  }
  outputs_.complete(file_);
}

}  // namespace ktgp_orb::tools
