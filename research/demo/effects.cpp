#include "demo/effects.h"

#include <cmath>
#include <opencv2/imgproc.hpp>

namespace ktgp_orb::demo {
namespace {

/// The mean picture over an exposure of `seconds` around `t`.
cv::Mat expose(const cv::Mat& map, double t, double seconds, const Manner& manner) {
  constexpr int kInstants = 15;
  cv::Mat sum(kImageHeight, kImageWidth, CV_32FC3, cv::Scalar::all(0.0));
  for (int i = 0; i < kInstants; ++i) {
    const double offset = ((i + 0.5) / kInstants - 0.5) * seconds;
    cv::accumulate(render(map, imageFromMap(t + offset, manner)), sum);
  }
  cv::Mat image;
  sum.convertTo(image, CV_8U, 1.0 / kInstants);
  return image;
}

}  // namespace

void changeLight(double t, cv::Mat& image) {
  const double gain = 0.75 + 0.45 * std::sin(2.5 * t) + 0.06 * std::sin(40.0 * t);
  const double gamma = 1.0 + 0.35 * std::sin(1.7 * t);
  cv::Mat curve(1, 256, CV_8U);
  for (int i = 0; i < 256; ++i) {
    curve.at<std::uint8_t>(i) =
        cv::saturate_cast<std::uint8_t>(255.0 * gain * std::pow(i / 255.0, gamma));
  }
  cv::LUT(image, curve, image);
  const double edge = image.cols * (0.5 + 0.6 * std::sin(1.9 * t));
  for (int x = 0; x < image.cols; ++x) {
    const double light = 0.55 + 0.45 / (1.0 + std::exp((x - edge) / 12.0));
    cv::Mat column = image.col(x);
    column.convertTo(column, -1, light);
  }
}

void addNoise(std::uint64_t seed, cv::Mat& image) {
  constexpr double kReadNoise = 7.0;  // grey values, standard deviation
  constexpr double kElectrons = 1.2;  // per grey value: fewer electrons mean more shot noise
  cv::RNG rng(seed);
  for (int y = 0; y < image.rows; ++y) {
    auto* row = image.ptr<std::uint8_t>(y);
    for (int x = 0; x < image.cols * image.channels(); ++x) {
      const double sigma = std::sqrt(kReadNoise * kReadNoise + row[x] / kElectrons);
      row[x] = cv::saturate_cast<std::uint8_t>(row[x] + rng.gaussian(sigma));
    }
  }
}

Segment segmentOf(int frame, int frames) {
  const int sixth = 6 * frame / frames;
  if (sixth < 3) return Segment::clean;
  if (sixth == 3) return Segment::lighting;
  return sixth == 4 ? Segment::blur : Segment::noise;
}

const char* toString(Segment segment) {
  switch (segment) {
    case Segment::clean:
      return "clean";
    case Segment::lighting:
      return "lighting";
    case Segment::blur:
      return "blur";
    case Segment::noise:
      return "noise";
  }
  return "unknown";
}

cv::Mat takePicture(const cv::Mat& map, int frame, int frames, std::uint64_t seed,
                    const Manner& manner) {
  constexpr double kLongExposure = 0.7 / kFrameRate;  // s
  const double t = frame / kFrameRate;
  const Segment segment = segmentOf(frame, frames);
  if (segment == Segment::blur) return expose(map, t, kLongExposure, manner);
  cv::Mat image = render(map, imageFromMap(t, manner));
  if (segment == Segment::lighting) changeLight(t, image);
  if (segment == Segment::noise) addNoise(seed + static_cast<std::uint64_t>(frame), image);
  return image;
}

}  // namespace ktgp_orb::demo
