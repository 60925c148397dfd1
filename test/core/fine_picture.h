#pragma once

#include <Eigen/Core>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <random>
#include <string>
#include <vector>

#include "test_data.h"

namespace ktgp_orb::test {

/// A picture of much finer pixels than the views of it, so that the true motion between two views
/// is known to far below a pixel: a view averages kFine x kFine fine pixels, and a camera that
/// moves by a fraction of a pixel moves by whole fine ones. Nothing is interpolated.
class FinePicture {
 public:
  static constexpr int kFine = 20;    // fine pixels along a pixel
  static constexpr int kMargin = 12;  // px around a view that has not moved

  explicit FinePicture(const cv::Size& view) : view_(view) {}

  /// Shapes of many sizes, in any direction, with corners anywhere between the pixels.
  static FinePicture drawn(const cv::Size& view, unsigned seed) {
    FinePicture picture(view);
    const cv::Size size = picture.fineSize();
    picture.fine_ = cv::Mat(size, CV_8U, cv::Scalar(110));
    std::mt19937 random(seed);
    const auto number = [&](int low, int high) {
      return std::uniform_int_distribution<int>(low, high)(random);
    };
    const int shapes = view.area() / 110;
    for (int i = 0; i < shapes; ++i) {
      const cv::Point2f centre(static_cast<float>(number(0, size.width)),
                               static_cast<float>(number(0, size.height)));
      const float length = static_cast<float>(number(2 * kFine, 22 * kFine));
      const float width = static_cast<float>(number(2 * kFine, 12 * kFine));
      const float angle = static_cast<float>(number(0, 359));
      cv::Point2f corners[4];
      cv::RotatedRect(centre, {length, width}, angle).points(corners);
      std::vector<cv::Point> polygon;
      for (const cv::Point2f& corner : corners) polygon.emplace_back(corner);
      cv::fillConvexPoly(picture.fine_, polygon, cv::Scalar(number(20, 235)));
    }
    return picture;
  }

  /// The middle of a photograph, enlarged.
  static FinePicture ofPhotograph(const cv::Size& view, const cv::Mat& grey) {
    FinePicture picture(view);
    const cv::Size size = picture.fineSize();
    const double scale = std::min(grey.cols / static_cast<double>(size.width),
                                  grey.rows / static_cast<double>(size.height));
    const cv::Size part(static_cast<int>(scale * size.width),
                        static_cast<int>(scale * size.height));
    const cv::Rect middle(cv::Point((grey.cols - part.width) / 2, (grey.rows - part.height) / 2),
                          part);
    cv::resize(grey(middle), picture.fine_, size, 0.0, 0.0, cv::INTER_CUBIC);
    return picture;
  }

  /// What a camera sees that has moved by whole fine pixels: the picture's content moves by
  /// (x, y) / kFine px.
  cv::Mat moved(int x, int y) const {
    const cv::Point start(kMargin * kFine - x, kMargin * kFine - y);
    cv::Mat view;
    cv::resize(fine_(cv::Rect(start, view_ * kFine)), view, view_, 0.0, 0.0, cv::INTER_AREA);
    return view;
  }

  /// What a camera sees that has moved by `homography` (px, from the view that has not moved): the
  /// mean over 11x11 places in each pixel, each the nearest fine pixel.
  cv::Mat moved(const Eigen::Matrix3d& homography) const {
    constexpr int kPlaces = 11;
    constexpr double kSide = 1.0 / kPlaces;
    const Eigen::Matrix3d back = homography.inverse();
    cv::Mat view(view_, CV_8U);
    for (int y = 0; y < view_.height; ++y) {
      for (int x = 0; x < view_.width; ++x) {
        int sum = 0;
        for (int i = 0; i < kPlaces; ++i) {
          for (int j = 0; j < kPlaces; ++j) {
            const Eigen::Vector3d seen(x - 0.5 + (j + 0.5) * kSide, y - 0.5 + (i + 0.5) * kSide,
                                       1.0);
            const Eigen::Vector3d p = back * seen;
            sum += fineAt(p.x() / p.z(), p.y() / p.z());
          }
        }
        view.at<std::uint8_t>(y, x) =
            static_cast<std::uint8_t>((sum + kPlaces * kPlaces / 2) / (kPlaces * kPlaces));
      }
    }
    return view;
  }

 private:
  cv::Size fineSize() const {
    return {(view_.width + 2 * kMargin) * kFine, (view_.height + 2 * kMargin) * kFine};
  }

  std::uint8_t fineAt(double x, double y) const {
    const auto place = [](double v, int size) {
      const int fine = static_cast<int>(std::floor((v + 0.5 + kMargin) * kFine));
      return std::clamp(fine, 0, size - 1);
    };
    return fine_.at<std::uint8_t>(place(y, fine_.rows), place(x, fine_.cols));
  }

  cv::Size view_;
  cv::Mat fine_;
};

/// The image with normal noise of that deviation.
inline cv::Mat withNoise(const cv::Mat& image, double deviation, std::uint64_t seed) {
  if (deviation <= 0.0) return image.clone();
  cv::Mat noise(image.size(), CV_32F);
  cv::RNG(seed).fill(noise, cv::RNG::NORMAL, 0.0, deviation);
  cv::Mat noisy;
  cv::add(image, noise, noisy, cv::noArray(), CV_8U);
  return noisy;
}

/// Photographs of Debian's opencv-doc and among the test data, where they are there. All have
/// texture in all quarters: elsewhere the error at a corner is that of an extrapolation.
inline std::vector<std::string> photographs() {
  std::vector<std::string> paths;
  if (const std::optional<std::string> debian = photoFolder()) {
    for (const char* name : {"starry_night.jpg", "aloeL.jpg", "board.jpg", "building.jpg"}) {
      paths.push_back(*debian + "/" + name);
    }
  }
  const std::optional<std::string> folder = dataFolder();
  if (!folder) return paths;
  for (const char* name :
       {"oxford/leuven/img1.ppm", "oxford/bikes/img1.ppm", "oxford/boat/img1.pgm",
        "hard/dogman/1.ppm", "hard/evd/1/adam.png", "hard/evd/1/cafe.png",
        "hard/homogr/BostonLibA.png", "hard/homogr/BruggeTowerA.png", "hard/homogr/EiffelA.png",
        "hard/homogr/LePoint1A.png", "hard/homogr/WhiteBoardA.jpg", "hard/notredame/img1.png",
        "targets_real/books_scene.png"}) {
    paths.push_back(*folder + "/" + name);
  }
  return paths;
}

}  // namespace ktgp_orb::test
