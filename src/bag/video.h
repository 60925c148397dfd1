#pragma once

#include <memory>
#include <string>
#include <vector>

#include "bag/reader.h"

namespace ktgp_orb {

/// Kinds of input that can stand in place of a bag.
enum class InputKind { bag, video, images };

/// Decides by the first line of the file and the ending ".bag"; a name with * ? [ that is not a
/// file is the pattern of images; anything else is a video.
InputKind kindOf(const std::string& path);

/// Opens a video that OpenCV can read. The stamp of an image is its time in the video; 1 ns for the
/// first image, since ROS takes zero for no time. `rate`: images per second; 0: the times of the
/// container. Throws UnusableBag.
std::unique_ptr<ImageSource> openVideo(const std::string& path, const BagSelection& selection,
                                       double rate);

/// Opens all images whose names fit the pattern, "img2.png" before "img10.png", at `rate` images
/// per second. `longest_side`: images with a longer side than this are shrunk to it, px; 0: no
/// limit. Throws UnusableBag.
std::unique_ptr<ImageSource> openImages(const std::string& pattern, const BagSelection& selection,
                                        double rate, int longest_side);

/// The files that are read: those that fit a pattern, else the input itself.
std::vector<std::string> filesOfInput(const std::string& path);

/// Images per second of a video; 0 where the container does not say.
double rateOfVideo(const std::string& path);

}  // namespace ktgp_orb
