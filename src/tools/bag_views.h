#pragma once

#include <ktgp_orb/HomographyStamped.h>
#include <sensor_msgs/Image.h>

#include <cstddef>
#include <memory>
#include <opencv2/core.hpp>
#include <optional>
#include <string>
#include <vector>

#include "files/output_file.h"
#include "ktgp_orb/mosaic.h"
#include "tools/steady_video.h"
#include "tools/view_options.h"

namespace ktgp_orb {

/// Name of the picture of a map, counted from 1: "map.png", "map-2.png", ...
std::string mosaicOf(const std::string& path, std::size_t number);

/// Writes the steady video and the mosaic of a bag's images, with the same code as the nodelets.
class BagViews {
 public:
  /// `reopen`: for the steady video.
  BagViews(const ViewOptions& options, Reopen reopen);

  /// The next image, with its homography. Throws RefusedImage and FileError.
  void add(const sensor_msgs::ImageConstPtr& image, const HomographyStamped& homography);
  /// Completes the files; a file without images is not written. Throws FileError.
  void close();
  /// The outcome in lines for users; empty if nothing was wanted.
  std::string report() const;

 private:
  void writeMap(const cv::Mat& image);

  ViewOptions options_;
  std::optional<SteadyVideo> steady_;
  Mosaic mosaic_;
  std::vector<std::unique_ptr<files::OutputFile>> maps_;  // complete, but without their names
  std::size_t placed_ = 0;
  std::size_t lost_ = 0;
  std::size_t ambiguous_ = 0;  // of the lost ones: the ground repeats
  double place_milliseconds_ = 0.0;
  std::string poses_;
};

}  // namespace ktgp_orb
