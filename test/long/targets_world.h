#pragma once

#include <algorithm>
#include <map>
#include <opencv2/imgproc.hpp>
#include <set>
#include <string>
#include <vector>

#include "target_world.h"

/// The world of the targets' soak: pictures, frames that show some of them, and what is known.
namespace ktgp_orb::test {

constexpr int kPictures = 80;
const cv::Size kPictureSize(300, 220);

inline cv::Mat picture(int number) {
  return drawnPicture(kPictureSize, static_cast<std::uint64_t>(number));
}

/// A picture in a frame.
struct Shown {
  int picture;
  Eigen::Matrix3d homography;  // picture -> frame, px
};

struct TargetScene {
  cv::Mat image;
  std::vector<Shown> shown;
};

/// One or two pictures on a background, each at least 120 px wide; in every eighth scene one of
/// them twice.
inline TargetScene sceneOf(int number, const cv::Size& size) {
  cv::RNG random(static_cast<std::uint64_t>(number) + 1);
  TargetScene scene;
  cv::Mat canvas;
  drawnPicture(size, 5000 + static_cast<std::uint64_t>(number)).convertTo(canvas, CV_32F);
  const int first = random.uniform(0, kPictures);
  const int second = number % 8 == 0 ? first : (first + 1 + number % 7) % kPictures;
  for (int i = 0; i < 2; ++i) {
    Placement place;
    place.tilt = random.uniform(0.0, 0.5);
    place.axis = random.uniform(0.0, 6.28);
    place.turn = random.uniform(-0.4, 0.4);
    place.zoom = random.uniform(0.42, 0.5);
    place.middle = {size.width * (i == 0 ? 0.26 : 0.74), size.height * random.uniform(0.4, 0.6)};
    const int shown = i == 0 ? first : second;
    scene.shown.push_back({shown, homographyOf(place, kPictureSize)});
    test::place(picture(shown), scene.shown.back().homography, canvas);
  }
  canvas.convertTo(scene.image, CV_8U);
  return scene;
}

/// Which targets are known, with the numbers of their pictures. No picture belongs to two.
class Known {
 public:
  Known() {
    for (int i = 0; i < kPictures; ++i) free_.insert(i);
  }

  std::size_t size() const { return targets_.size(); }
  const std::map<std::string, std::vector<int>>& targets() const { return targets_; }
  bool has(const std::string& id) const { return targets_.count(id) > 0; }
  bool shows(const std::string& id, int picture) const {
    const auto it = targets_.find(id);
    return it != targets_.end() &&
           std::find(it->second.begin(), it->second.end(), picture) != it->second.end();
  }
  bool isFree(int picture) const { return free_.count(picture) > 0; }
  std::string drawId(cv::RNG& random) const {
    return std::next(targets_.begin(), random.uniform(0, static_cast<int>(size())))->first;
  }
  int drawFree(cv::RNG& random) const {
    return *std::next(free_.begin(), random.uniform(0, static_cast<int>(free_.size())));
  }

  void set(const std::string& id, const std::vector<int>& pictures) {
    remove(id);
    targets_[id] = pictures;
    for (const int picture : pictures) free_.erase(picture);
  }
  void remove(const std::string& id) {
    const auto it = targets_.find(id);
    if (it == targets_.end()) return;
    free_.insert(it->second.begin(), it->second.end());
    targets_.erase(it);
  }

 private:
  std::map<std::string, std::vector<int>> targets_;
  std::set<int> free_;
};

}  // namespace ktgp_orb::test
