#pragma once

#include <ktgp_orb/MatchStatistics.h>

#include <limits>
#include <map>
#include <string>
#include <vector>

namespace ktgp_orb::demo {

/// Data of a frame in addition to its statistics.
struct FrameResult {
  std::string segment;
  /// Mean error of the homography at the corners of the image, px; infinite if none was found.
  double error = std::numeric_limits<double>::infinity();
  double reprojection_error = 0.0;  ///< RMS of the final matches against the true homography, px
};

/// The status line of the running demo.
std::string frameLine(std::size_t frame, std::size_t frames, const MatchStatistics& statistics,
                      const FrameResult& result);

/// Collects the frames and summarises them, in total and for each part of the flight.
class ResultTable {
 public:
  void add(const MatchStatistics& statistics, const FrameResult& result);
  std::size_t frames() const { return all_.frames; }

  /// `in_bag`: number of frames in the bag.
  std::string text(std::size_t in_bag) const;

 private:
  struct Column {
    std::size_t frames = 0;
    std::size_t found = 0;                // frames with a homography
    std::vector<double> counts[5];        // features, knn, tf, gms, prosac
    std::vector<double> milliseconds[6];  // extraction, knn, tf, gms, prosac, total
    std::vector<double> retention;
    std::vector<double> error;               // px, of the homographies found
    std::vector<double> reprojection_error;  // px
    void add(const MatchStatistics& statistics, const FrameResult& result);
  };

  Column all_;
  std::vector<std::string> order_;  // names of the segments, in order of appearance
  std::map<std::string, Column> segments_;
  std::size_t dropped_ = 0;
};

}  // namespace ktgp_orb::demo
