#include "bag/video.h"

#include <cv_bridge/cv_bridge.h>
#include <glob.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <deque>
#include <filesystem>
#include <fstream>
#include <opencv2/core/utils/logger.hpp>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <opencv2/videoio.hpp>

#include "bag/name_order.h"
#include "files/input.h"
#include "files/tiff_pages.h"
#include "util/counted.h"
#include "util/printable.h"

namespace ktgp_orb {
namespace {

bool endsWith(const std::string& text, const std::string& end) {
  return text.size() >= end.size() && text.compare(text.size() - end.size(), end.size(), end) == 0;
}

/// Returns true if the file begins with the bytes `start`. Returns false for a pipe: reading from
/// it could block, and the bytes would be lost for whoever reads the pipe later.
bool beginsWith(const std::string& path, const std::string& start) {
  std::error_code none;
  if (!std::filesystem::is_regular_file(path, none)) return false;
  std::string first(start.size(), '\0');
  std::ifstream(path).read(&first[0], static_cast<std::streamsize>(first.size()));
  return first == start;
}

/// Converts a time in seconds to a stamp of at least 1 ns, because zero means "no time" in ROS and
/// cannot be stored in a bag.
ros::Time stampOf(double seconds) {
  return std::max(ros::TIME_MIN, ros::Time(std::max(seconds, 0.0)));
}

RecordedImage recorded(const cv::Mat& image, const ros::Time& stamp) {
  std_msgs::Header header;
  header.stamp = stamp;
  header.frame_id = "camera";
  const bool wide = image.depth() == CV_16U;
  const char* const encoding =
      image.channels() == 1 ? (wide ? "mono16" : "mono8") : (wide ? "bgr16" : "bgr8");
  return {cv_bridge::CvImage(header, encoding, image).toImageMsg(), stamp};
}

bool isAfter(double seconds, const BagSelection& selection) {
  return selection.duration >= 0.0 && seconds > selection.start + selection.duration;
}

void refuseTopic(const std::string& path, const BagSelection& selection) {
  if (selection.topic.empty()) return;
  throw UnusableBag(path +
                    " is not a bag, so there is no topic to choose; leave --topic out "
                    "(--name sets the names of the output)");
}

/// Opens the video with FFmpeg or GStreamer. Does not use cv::CAP_ANY, which would also try cameras
/// and image patterns. Suppresses the messages of OpenCV and FFmpeg about a file that is not a
/// video, because the caller reports it.
bool opened(const std::string& path, cv::VideoCapture& video) {
  setenv("OPENCV_FFMPEG_LOGLEVEL", "-8", 0);
  const auto level = cv::utils::logging::setLogLevel(cv::utils::logging::LOG_LEVEL_SILENT);
  const bool done = video.open(path, cv::CAP_FFMPEG) || video.open(path, cv::CAP_GSTREAMER);
  cv::utils::logging::setLogLevel(level);
  return done;
}

/// Counts all images of the video, including those that players do not show: an MP4 or MOV that was
/// cut without re-encoding still contains such images. FFmpeg returns them only with an option,
/// which OpenCV reads from the environment.
std::size_t imagesIn(const std::string& path) {
  constexpr char kOptions[] = "OPENCV_FFMPEG_CAPTURE_OPTIONS";
  const char* const given = std::getenv(kOptions);
  const std::string before = given == nullptr ? "" : given;
  setenv(kOptions, "ignore_editlist;1", 1);
  cv::VideoCapture video;
  opened(path, video);
  before.empty() ? unsetenv(kOptions) : setenv(kOptions, before.c_str(), 1);
  std::size_t count = 0;
  while (video.grab()) ++count;
  return count;
}

/// How to find out whether a video lacks images.
enum class Container {
  counted,   ///< MP4, MOV and AVI store the number of images
  matroska,  ///< stores its own length in bytes
  other      ///< OpenCV estimates the number of images from the length in seconds and a usual rate
};

Container containerOf(const std::string& path) {
  constexpr char kMatroska[] = "\x1A\x45\xDF\xA3";
  std::string first(8, '\0');
  std::ifstream(path).read(&first[0], 8);
  if (first.rfind(kMatroska, 0) == 0) return Container::matroska;
  if (first.rfind("RIFF", 0) == 0) return Container::counted;
  for (const char* box : {"ftyp", "moov", "mdat", "wide", "free", "skip"}) {
    if (first.compare(4, 4, box) == 0) return Container::counted;
  }
  return Container::other;
}

/// Returns true if a Matroska file has fewer bytes than the header of its segment says. A recorder
/// that was killed, or wrote to a pipe, left no such number.
bool isCutMatroska(const std::string& path) {
  std::string bytes(4096, '\0');
  std::ifstream file(path, std::ios::binary);
  file.read(&bytes[0], static_cast<std::streamsize>(bytes.size()));
  bytes.resize(static_cast<std::size_t>(file.gcount()));
  // An element is an ID of four bytes, its size, and its data. The leading zeros of the first byte
  // of a size are the number of the bytes that follow it. If all other bits are ones, the size is
  // not known.
  std::size_t at = 0;
  const auto read_size = [&]() -> std::optional<std::uint64_t> {
    at += 4;
    std::size_t more = 0;
    while (at < bytes.size() && more < 8 &&
           (static_cast<std::uint8_t>(bytes[at]) << more & 0x80U) == 0)
      ++more;
    if (more > 7 || at + more >= bytes.size()) return std::nullopt;
    std::uint64_t size = static_cast<std::uint8_t>(bytes[at]) & (0x7FU >> more);
    for (std::size_t i = 1; i <= more; ++i)
      size = size << 8U | static_cast<std::uint8_t>(bytes[at + i]);
    at += more + 1;
    return size + 1 == std::uint64_t{1} << 7 * (more + 1) ? std::nullopt : std::make_optional(size);
  };
  const std::optional<std::uint64_t> header = read_size();
  if (!header || *header > bytes.size()) return false;
  at += *header;
  if (bytes.compare(std::min(at, bytes.size()), 4, "\x18\x53\x80\x67") != 0) return false;
  const std::optional<std::uint64_t> segment = read_size();
  std::error_code none;
  return segment && std::filesystem::file_size(path, none) < at + *segment;
}

class Video : public ImageSource {
 public:
  Video(const std::string& path, const BagSelection& selection, double rate)
      : path_(path), selection_(selection), rate_(rate) {
    refuseTopic(path, selection);
    if (!std::ifstream(path)) throw UnusableBag(path + " cannot be opened");
    if (!opened(path, video_)) {
      const std::string known = files::unreadableFormat(path);
      throw UnusableBag(path + (known.empty()
                                    ? " is neither a bag nor a video that OpenCV can read here"
                                    : " " + known));
    }
    const double fps = video_.get(cv::CAP_PROP_FPS);
    if (fps > 0.0 && fps < 1000.0) steps_ = {1.0 / fps};
    const double count = video_.get(cv::CAP_PROP_FRAME_COUNT);
    in_file_ = count > 0.0 && count < 1e9 ? static_cast<std::size_t>(count) : 0;
    queued_ = read();
    if (!queued_) throw UnusableBag(path + " has no readable image in the selected time");
  }

  std::optional<RecordedImage> next() override {
    std::optional<RecordedImage> image = std::move(queued_);
    if (image) queued_ = read();
    return image;
  }

  std::size_t total() const override {
    const double fps = rate_ > 0.0 ? rate_ : 1.0 / usualStep();
    const auto skipped = static_cast<std::size_t>(std::max(0.0, selection_.start * fps));
    std::size_t left = in_file_ - std::min(in_file_, skipped);
    if (selection_.duration >= 0.0) {
      left = std::min(left, static_cast<std::size_t>(selection_.duration * fps) + 1);
    }
    return left;
  }

  std::string damage() const override {
    if (!is_damaged_) return {};
    return "the video is damaged or cut off: " + std::to_string(read_) + " of " +
           std::to_string(std::max(in_file_, read_)) + " images could be read";
  }

 private:
  /// Returns true if the last image comes clearly before the end of the video.
  bool endsEarly() const {
    constexpr double kTolerance = 0.02;
    const double length = static_cast<double>(in_file_) / video_.get(cv::CAP_PROP_FPS);
    return (1.0 + kTolerance) * last_ + 2.0 * usualStep() < length;
  }
  bool lacksImages() const {
    const Container container = containerOf(path_);
    if (container == Container::matroska) return isCutMatroska(path_);
    return isTooFew(read_) && (container == Container::counted || endsEarly()) &&
           isTooFew(imagesIn(path_));
  }

  /// Returns true if `images` is clearly fewer than the file declares. Some files give only an
  /// estimate: it may be slightly wrong, or far too high if the first image is late.
  bool isTooFew(std::size_t images) const {
    constexpr std::size_t kTolerance = 50;  // 1 / kTolerance of the images may be missing
    constexpr std::size_t kMost = 100;  // if the declared number is kMost times too high, ignore it
    return images + 1 + in_file_ / kTolerance < in_file_ && in_file_ / kMost <= images;
  }

  std::optional<RecordedImage> read() {
    while (video_.grab()) {
      const auto number = static_cast<double>(read_++);
      const double in_file = timeInFile();
      const double seconds = rate_ > 0.0 ? number / rate_ : in_file;
      if (seconds < selection_.start) continue;
      if (isAfter(seconds, selection_)) return std::nullopt;
      cv::Mat image;
      if (!video_.retrieve(image) || image.empty()) continue;
      return recorded(image, stampOf(seconds));
    }
    is_damaged_ = lacksImages();
    return std::nullopt;
  }

  /// Video time of the last grabbed image, s. For the last images of a video with
  /// B-frames, OpenCV gives no time. We then add the usual step to the time of the previous image,
  /// because an equal time would look like a repeated image.
  double timeInFile() {
    const double seconds = 1e-3 * video_.get(cv::CAP_PROP_POS_MSEC);
    if (read_ == 1) return last_ = seconds > 0.0 && seconds < 1e9 ? seconds : 0.0;
    const bool is_known = seconds > last_ && seconds < 1e9;
    if (!is_known) return last_ += usualStep();
    constexpr std::size_t kSteps = 9;
    steps_.push_back(seconds - last_);
    if (steps_.size() > kSteps) steps_.pop_front();
    return last_ = seconds;
  }

  /// Median time between the last few images, s.
  double usualStep() const {
    std::vector<double> sorted(steps_.begin(), steps_.end());
    std::sort(sorted.begin(), sorted.end());
    return sorted[(sorted.size() - 1) / 2];
  }

  std::string path_;
  BagSelection selection_;
  double rate_;
  // Times between the last few images, s. The initial value is used until times are known, or if
  // the container gives none.
  std::deque<double> steps_{1.0 / 30.0};
  cv::VideoCapture video_;
  std::optional<RecordedImage> queued_;
  double last_ = 0.0;  // time of the last grabbed image, s
  std::size_t in_file_ = 0;
  std::size_t read_ = 0;
  bool is_damaged_ = false;
};

std::vector<std::string> filesOf(const std::string& pattern) {
  glob_t found{};
  std::vector<std::string> files;
  // The shell does not replace ~ in a quoted pattern.
  if (glob(pattern.c_str(), GLOB_TILDE, nullptr, &found) == 0) {
    files.assign(found.gl_pathv, found.gl_pathv + found.gl_pathc);
  }
  globfree(&found);
  bag::sortByNumbers(files);
  return files;
}

/// Tells users which of the file names do not belong to the same series; empty if all do.
std::string noteOnNames(const std::vector<std::string>& all) {
  const std::vector<std::string> two = bag::alternatingNames(all);
  if (!two.empty()) {
    return "the images of several series of names alternate: " + util::printable(two[0]) + ", " +
           util::printable(two[1]) + "; expected a pattern that fits one series";
  }
  const std::vector<std::string> odd = bag::oddNames(all);
  if (odd.empty()) return {};
  const auto place = std::find(all.begin(), all.end(), odd.front()) - all.begin();
  std::string note =
      util::printable(odd.front()) + ": its name is not like the others', which decide the " +
      "order; it is image " + std::to_string(place + 1) + " of " + std::to_string(all.size());
  if (odd.size() > 1) note += ", and there are " + std::to_string(odd.size() - 1) + " more such";
  return note;
}

class Images : public ImageSource {
 public:
  Images(const std::string& pattern, const BagSelection& selection, double rate, int longest_side)
      : longest_side_(longest_side) {
    refuseTopic(pattern, selection);
    const std::vector<std::string> all = filesOf(pattern);
    for (std::size_t i = 0; i < all.size(); ++i) {
      const double seconds = static_cast<double>(i) / rate;
      if (seconds < selection.start || isAfter(seconds, selection)) continue;
      files_.push_back({all[i], stampOf(seconds)});
    }
    if (all.empty()) throw UnusableBag(pattern + ": there is no such file, nor one that fits it");
    if (files_.empty()) throw UnusableBag(pattern + " has no image in the selected time");
    note_ = noteOnNames(all);
  }

  std::optional<RecordedImage> next() override {
    if (next_ == files_.size()) return std::nullopt;
    const auto& [file, stamp] = files_[next_++];
    try {
      cv::Mat image = files::readPicture(file, cv::IMREAD_COLOR | cv::IMREAD_ANYDEPTH);
      if (files::pagesIn(file) > 1 && with_pages_++ == 0) first_with_pages_ = file;
      const cv::Size in_file = image.size();
      const double scale = static_cast<double>(longest_side_) / std::max(image.cols, image.rows);
      if (scale > 0.0 && scale < 1.0) {
        const auto side = [scale](int length) { return std::max(1, cvRound(scale * length)); };
        cv::resize(image, image, {side(image.cols), side(image.rows)}, 0, 0, cv::INTER_AREA);
      }
      RecordedImage result = recorded(image, stamp);
      result.x_scale = static_cast<double>(image.cols) / in_file.width;
      result.y_scale = static_cast<double>(image.rows) / in_file.height;
      return result;
    } catch (const files::FileError& error) {
      return RecordedImage{nullptr, stamp, error.what()};
    }
  }

  std::size_t total() const override { return files_.size(); }
  std::string damage() const override { return {}; }
  std::string note() const override {
    if (with_pages_ == 0) return note_;
    return (note_.empty() ? "" : note_ + "; ") + files::noteOnPages(first_with_pages_) +
           (with_pages_ > 1 ? ", as of " + util::counted(with_pages_ - 1, "more file", "more files")
                            : "");
  }

 private:
  int longest_side_;
  std::string note_;
  std::string first_with_pages_;
  std::size_t with_pages_ = 0;  // files of which only the first page was used
  std::vector<std::pair<std::string, ros::Time>> files_;
  std::size_t next_ = 0;
};

}  // namespace

InputKind kindOf(const std::string& path) {
  std::error_code none;
  if (!std::filesystem::exists(path, none) && path.find_first_of("*?[") != std::string::npos)
    return InputKind::images;
  const bool bag = beginsWith(path, "#ROSBAG") || endsWith(path, ".bag");
  return bag ? InputKind::bag : InputKind::video;
}

std::vector<std::string> filesOfInput(const std::string& path) {
  if (kindOf(path) == InputKind::images) return filesOf(path);
  return {path};
}

std::unique_ptr<ImageSource> openVideo(const std::string& path, const BagSelection& selection,
                                       double rate) {
  return std::make_unique<Video>(path, selection, rate);
}

std::unique_ptr<ImageSource> openImages(const std::string& pattern, const BagSelection& selection,
                                        double rate, int longest_side) {
  return std::make_unique<Images>(pattern, selection, rate, longest_side);
}

double rateOfVideo(const std::string& path) {
  cv::VideoCapture video;
  opened(path, video);
  const double rate = video.get(cv::CAP_PROP_FPS);
  return std::isfinite(rate) && rate > 0.0 && rate < 1000.0 ? rate : 0.0;
}

}  // namespace ktgp_orb
