#pragma once

#include <sensor_msgs/Image.h>

#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <opencv2/core.hpp>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "bag/reader.h"
#include "cli/video_file.h"
#include "ktgp_orb/frame_path.h"
#include "ktgp_orb/stabilizer.h"
#include "tools/view_options.h"

namespace ktgp_orb {

/// Opens the recording again, from its beginning.
using Reopen = std::function<std::unique_ptr<ImageSource>()>;

/// Writes the steady video of a recording. For the path over the whole recording, the images are
/// read a second time, when all motions are known.
class SteadyVideo {
 public:
  SteadyVideo(const ViewOptions& options, Reopen reopen);

  /// The next image of `size`, at `stamp` ns, and its homography from the reference, if found.
  /// Throws RefusedImage and FileError.
  void add(const sensor_msgs::ImageConstPtr& image, std::int64_t stamp, std::int64_t reference,
           const std::optional<Eigen::Matrix3d>& homography);
  /// Completes the files; without images they are not written. Throws FileError.
  void close();
  /// The outcome in a line for users.
  std::string report() const;

 private:
  struct Frame {
    std::int64_t stamp = 0;
    cv::Size size;
    std::optional<Eigen::Matrix3d> step;  ///< from the previous frame
  };
  /// Mean shake over the parts of the video, px^2.
  struct Shake {
    double sum = 0.0;
    double count = 0.0;
    std::vector<Eigen::Matrix3d> steps;  ///< of the newest part
    void finishPart(const cv::Size& size);
    double mean() const { return count > 0.0 ? sum / count : 0.0; }
  };

  std::vector<SteadyFrame> wholePath() const;
  void writeWhole();
  void writeReady();
  void write(const SteadyFrame& steady, const cv::Mat& frame,
             const std::optional<Eigen::Matrix3d>& step);

  ViewOptions options_;
  Reopen reopen_;
  tools::VideoFile video_;
  FramePath path_;
  std::vector<Frame> frames_;  ///< of the whole recording

  Stabilizer stabilizer_;
  /// Frames whose position is not known yet, and their steps.
  std::map<std::int64_t, std::pair<cv::Mat, std::optional<Eigen::Matrix3d>>> waiting_;
  std::vector<SteadyFrame> ready_;

  std::optional<SteadyFrame> last_;
  cv::Size size_;
  Shake before_;
  Shake after_;
  std::size_t written_ = 0;
  double milliseconds_ = 0.0;
  std::string warps_;
};

}  // namespace ktgp_orb
