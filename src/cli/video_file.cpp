#include "cli/video_file.h"

#include <opencv2/imgproc.hpp>
#include <opencv2/videoio.hpp>

#include "files/input.h"

namespace ktgp_orb::tools {

struct VideoFile::Writer {
  cv::VideoWriter video;
  cv::Size size;
};

VideoFile::VideoFile(const std::string& path, double rate, bool force)
    : path_(path), rate_(rate), file_(path, force), writer_(std::make_unique<Writer>()) {}

VideoFile::~VideoFile() = default;

// H.264 if there is an encoder, since browsers do not show MPEG-4; it needs even sides.
void VideoFile::open(const cv::Size& size) {
  writer_->size = cv::Size(size.width / 2 * 2, size.height / 2 * 2);
  for (const char* codec : {"avc1", "mp4v"}) {
    const int code = cv::VideoWriter::fourcc(codec[0], codec[1], codec[2], codec[3]);
    for (const int backend : {cv::CAP_FFMPEG, cv::CAP_GSTREAMER}) {
      if (writer_->video.open(file_.unfinished(), backend, code, rate_, writer_->size)) return;
    }
  }
  throw files::FileError(path_,
                         "OpenCV of this machine cannot write mp4; expected a build with FFmpeg or "
                         "GStreamer, as Debian's and Ubuntu's are");
}

void VideoFile::write(const cv::Mat& frame) {
  if (!writer_->video.isOpened()) open(frame.size());
  cv::Mat colour = frame;
  if (frame.channels() == 1) cv::cvtColor(frame, colour, cv::COLOR_GRAY2BGR);
  if (colour.size() != writer_->size) {
    cv::resize(colour, colour, writer_->size, 0, 0, cv::INTER_AREA);
  }
  writer_->video.write(colour);
  ++frames_;
}

bool VideoFile::empty() const {
  return !writer_->video.isOpened();
}

void VideoFile::close() {
  if (!writer_->video.isOpened())
    throw files::FileError(path_, "is not written: there was no frame");
  writer_->video.release();
  // The writer does not say when the disk is full.
  const cv::VideoCapture written(file_.unfinished());
  if (!written.isOpened() || written.get(cv::CAP_PROP_FRAME_COUNT) < frames_) {
    files::throwUnwritable(file_, "the video lacks frames; expected more space on the disk");
  }
  file_.commit();
}

}  // namespace ktgp_orb::tools
