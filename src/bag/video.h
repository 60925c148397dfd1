#pragma once

#include <memory>
#include <string>
#include <vector>

#include "bag/reader.h"

namespace ktgp_orb {

/// Types of recordings that the programs can read.
enum class InputKind { bag, video, images };

/// Decides what `path` is. A name with *, ? or [ is a pattern of image files, unless a file has
/// exactly this name. A file is a bag if it begins like a bag or its name ends in ".bag". Anything
/// else is a video.
InputKind kindOf(const std::string& path);

/// Opens a video that OpenCV can read. The stamp of an image is its time in the video; a time of
/// zero becomes 1 ns, because zero means "no time" in ROS. `rate`: images per second; 0: use the
/// times in the video file. Throws UnusableBag.
std::unique_ptr<ImageSource> openVideo(const std::string& path, const BagSelection& selection,
                                       double rate);

/// Opens all images whose names match the pattern, sorted by number ("img2.png" before
/// "img10.png"), as a recording with `rate` images per second. Shrinks images whose longer side
/// exceeds `longest_side` pixels; 0: no limit. A ~ at the beginning is the home folder. Throws
/// UnusableBag.
std::unique_ptr<ImageSource> openImages(const std::string& pattern, const BagSelection& selection,
                                        double rate, int longest_side);

/// The input files: all files that match `path` if it is a pattern, otherwise only `path`.
std::vector<std::string> filesOfInput(const std::string& path);

/// Images per second of a video; 0 if the file does not say.
double rateOfVideo(const std::string& path);

}  // namespace ktgp_orb
