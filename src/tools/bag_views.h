#pragma once

#include <ktgp_orb/HomographyStamped.h>
#include <sensor_msgs/CameraInfo.h>
#include <sensor_msgs/Image.h>

#include <CLI/CLI.hpp>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <functional>
#include <memory>
#include <opencv2/core.hpp>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "bag/reader.h"
#include "files/output_file.h"
#include "ktgp_orb/frame_path.h"
#include "ktgp_orb/lens.h"
#include "ktgp_orb/mosaic.h"
#include "ktgp_orb/stabilizer.h"
#include "ros/camera.h"
#include "tools/video_file.h"

namespace ktgp_orb::tools {

/// Options for the files with views; an empty name means that the file is not written.
struct ViewOptions {
  std::string video;  ///< name of the mp4 file with the steady video
  /// name of the csv file with the homographies from the frames to the steady images
  std::string warps;
  /// True: smooth the path with all frames of the recording (see steadyPath). False: smooth it as
  /// the nodelet does, with only a few later frames (StabilizerOptions::lag).
  bool whole = true;
  StabilizerOptions stabilizer;
  double rate = 30.0;  ///< rate of the video, 1/s
  /// name of the png file of the first map; mosaicOf() makes the names of further maps from it
  std::string mosaic;
  /// name of the csv file with the homographies from the map to the frames
  std::string mosaic_poses;
  MosaicOptions map;
  LensConstPtr lens;  ///< lens whose distortion is removed from the images; null: none
};

/// Adds --stabilize, --mosaic and the options that belong to them.
void addViewOptions(CLI::App& app, ViewOptions& views);
/// Call this after parsing. Throws std::invalid_argument if an option needs a part that was left
/// out of this build.
void completeViewOptions(const CLI::App& app, ViewOptions& views);

/// Opens the recording again, from its beginning.
using Reopen = std::function<std::unique_ptr<ImageSource>()>;

/// Writes the steady video of a recording. For the path over the whole recording, reads the images
/// twice, because it can compute this path only when all motions are known.
class SteadyVideo {
 public:
  SteadyVideo(const ViewOptions& options, Reopen reopen, files::Outputs& outputs);

  /// Adds the next image. `stamp`: its time in ns. `homography`: from the frame with the stamp
  /// `reference` to this image; empty if none was found. Throws RefusedImage and FileError.
  void add(const sensor_msgs::ImageConstPtr& image, std::int64_t stamp, std::int64_t reference,
           const std::optional<Eigen::Matrix3d>& homography);
  /// Shows the previous image once more, so that the video keeps its rate.
  void repeat();
  /// Completes the files. If there were no images, no files are written. Throws FileError.
  void close();
  /// One-line summary for users.
  std::string report() const;

 private:
  struct Frame {
    std::int64_t stamp = 0;
    cv::Size size;
    std::optional<Eigen::Matrix3d> step;  ///< homography from the previous frame
    int repeats = 0;                      ///< how often the image is shown again
  };
  struct Waiting {
    cv::Mat image;
    std::optional<Eigen::Matrix3d> step;
    int repeats = 0;
  };
  /// Computes the mean squared shake of the video, px². A part of the video is a sequence of frames
  /// that are connected by homographies.
  struct Shake {
    double sum = 0.0;
    double count = 0.0;
    /// homographies from each frame to the next in the newest part
    std::vector<Eigen::Matrix3d> steps;
    void finishPart(const cv::Size& size);
    double mean() const { return count > 0.0 ? sum / count : 0.0; }
  };

  std::vector<SteadyFrame> wholePath() const;
  void writeWhole();
  void writeReady();
  void write(const SteadyFrame& steady, const Waiting& frame);

  ViewOptions options_;
  Reopen reopen_;
  files::Outputs& outputs_;
  tools::VideoFile video_;
  FramePath path_;
  std::vector<Frame> frames_;  ///< all frames of the recording

  Stabilizer stabilizer_;
  /// Frames that wait until the stabilizer returns their homographies, which it does in the order
  /// of add(). Stamps do not identify them: several images may have the same stamp.
  std::deque<Waiting> waiting_;
  std::vector<SteadyFrame> ready_;

  std::optional<SteadyFrame> last_;
  cv::Mat picture_;  // picture that was written last
  cv::Size size_;
  Shake before_;
  Shake after_;
  std::size_t written_ = 0;
  double milliseconds_ = 0.0;
  std::string warps_;
};

/// Name of the file with map `number`, counted from 1: "map.png", "map-2.png", ...
std::string mosaicOf(const std::string& path, std::size_t number);
/// Names of the second map and of all later maps that exist, for example of an earlier run with
/// more maps. Empty if `path` is.
std::vector<std::string> furtherMaps(const std::string& path);

/// Writes the steady video and the mosaic of a recording's images, with the same code as the
/// nodelets.
class BagViews {
 public:
  /// `reopen`: called when the steady video reads the images a second time. `outputs` must outlive
  /// this object. `camera`: calibration of the images, which a panorama needs. `pixels`: whether
  /// the images are raw or rectified.
  BagViews(const ViewOptions& options, Reopen reopen, files::Outputs& outputs,
           std::optional<sensor_msgs::CameraInfo> camera, Pixels pixels);

  /// Adds the next image with its homography. Throws RefusedImage and FileError.
  void add(const sensor_msgs::ImageConstPtr& image, const HomographyStamped& homography);
  void repeat() {
    if (steady_) steady_->repeat();
  }
  /// Completes the files. If there were no images for a file, it is not written. Throws FileError.
  void close();
  /// Summary for users in a few lines; empty if no views were wanted.
  std::string report() const;

 private:
  void writeMap(const cv::Mat& image);
  std::string panorama() const;

  ViewOptions options_;
  files::Outputs& outputs_;
  std::optional<SteadyVideo> steady_;
  Mosaic mosaic_;
  std::size_t maps_ = 0;  // maps written
  std::size_t placed_ = 0;
  std::size_t lost_ = 0;
  // Number of frames lost because the ground has a repeating pattern, so that they fit in several
  // places.
  std::size_t repeated_ = 0;
  std::optional<sensor_msgs::CameraInfo> camera_;
  Pixels pixels_;
  std::size_t unfit_ = 0;  // number of frames lost because they do not fit on the map's surface
  std::size_t unfit_before_turn_ = 0;  // of these, frames lost before the map was on a cylinder
  std::string why_unfit_;              // why the last of these frames does not fit
  double place_milliseconds_ = 0.0;
  std::string poses_;
};

}  // namespace ktgp_orb::tools
