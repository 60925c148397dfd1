#pragma once

#include <ktgp_orb/HomographyStamped.h>
#include <sensor_msgs/Image.h>

#include <cstdint>
#include <map>
#include <memory>
#include <opencv2/core.hpp>
#include <optional>
#include <string>
#include <vector>

#include "cli/video_file.h"
#include "ktgp_orb/mosaic.h"
#include "ktgp_orb/stabilizer.h"

namespace ktgp_orb {

/// Files with views; empty names: none.
struct ViewOptions {
  std::string stabilized;    ///< mp4
  std::string warps;         ///< csv: the frame -> steady picture homography of each frame
  std::string mosaic;        ///< png, of the first map; mosaicOf names those of further maps
  std::string mosaic_poses;  ///< csv: the map -> frame homography of each frame
  StabilizerOptions stabilizer;
  MosaicOptions map;
  bool force = false;  ///< may overwrite files
};

/// Name of the picture of a map, counted from 1: "map.png", "map-2.png", ...
std::string mosaicOf(const std::string& path, std::size_t number);

/// Writes the steady video and the mosaic of a bag's images, with the same code as the nodelets.
class BagViews {
 public:
  explicit BagViews(const ViewOptions& options);

  /// The next image, with its homography. Throws RefusedImage and FileError.
  void add(const sensor_msgs::ImageConstPtr& image, const HomographyStamped& homography);
  /// Completes the files; a file without images is not written. Throws FileError.
  void close();
  /// The outcome in lines for users; empty if nothing was wanted.
  std::string report() const;

 private:
  void stabilize(const sensor_msgs::ImageConstPtr& image, const HomographyStamped& homography,
                 const std::optional<Eigen::Matrix3d>& step);
  void writeReady();
  void writeMap(const cv::Mat& image);

  ViewOptions options_;
  Stabilizer stabilizer_;
  std::optional<tools::VideoFile> video_;
  std::map<std::int64_t, cv::Mat> waiting_;        // frames whose position is not known yet
  std::map<std::int64_t, Eigen::Matrix3d> steps_;  // previous frame -> frame
  std::vector<SteadyFrame> ready_;
  std::optional<SteadyFrame> last_steady_;
  std::vector<Eigen::Matrix3d> before_;  // steps between neighbouring frames of the newest path
  std::vector<Eigen::Matrix3d> after_;
  struct Shake {
    double sum = 0.0;
    double count = 0.0;
    void add(const std::vector<Eigen::Matrix3d>& steps, const cv::Size& size);
    double mean() const { return count > 0.0 ? sum / count : 0.0; }
  };
  Shake shake_before_;
  Shake shake_after_;
  double warp_milliseconds_ = 0.0;
  std::size_t frames_ = 0;
  std::int64_t last_stamp_ = -1;
  cv::Size size_;

  Mosaic mosaic_;
  std::vector<std::unique_ptr<tools::OutputFile>> maps_;  // complete, but without their names
  std::size_t placed_ = 0;
  std::size_t lost_ = 0;
  double place_milliseconds_ = 0.0;
  std::string poses_;
  std::string warps_;
};

}  // namespace ktgp_orb
