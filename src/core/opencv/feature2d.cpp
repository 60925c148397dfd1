#include <opencv2/imgproc.hpp>

#include "ktgp_orb/opencv.h"

namespace ktgp_orb {
namespace {

OrbOptions withoutImages(OrbOptions options) {
  options.images = ImageKeeping::none;
  return options;
}

cv::Mat greyOf(const cv::Mat& image) {
  if (image.type() != CV_8UC3 && image.type() != CV_8UC4) return image;
  cv::Mat grey;
  cv::cvtColor(image, grey, image.channels() == 3 ? cv::COLOR_BGR2GRAY : cv::COLOR_BGRA2GRAY);
  return grey;
}

class OrbFeature2D : public cv::Feature2D {
 public:
  explicit OrbFeature2D(const OrbOptions& options) : extractor_(withoutImages(options)) {}

  void detectAndCompute(cv::InputArray image, cv::InputArray mask,
                        std::vector<cv::KeyPoint>& keypoints, cv::OutputArray descriptors,
                        bool use_provided_keypoints) override {
    if (use_provided_keypoints) {
      refuseUnlessEmpty(keypoints, descriptors);
      return;
    }
    extractor_.extract(greyOf(image.getMat()), mask.getMat(), features_);
    keypoints = features_.keypoints;
    if (!descriptors.needed()) return;
    if (keypoints.empty()) {
      descriptors.release();
    } else {
      features_.descriptors.copyTo(descriptors);
    }
  }

  int descriptorSize() const override { return kDescriptorBytes; }
  int descriptorType() const override { return CV_8U; }
  int defaultNorm() const override { return cv::NORM_HAMMING; }
  bool empty() const override { return false; }
  cv::String getDefaultName() const override { return cv::Feature2D::getDefaultName() + ".KTGP"; }

 private:
  static void refuseUnlessEmpty(const std::vector<cv::KeyPoint>& keypoints,
                                cv::OutputArray descriptors) {
    if (!keypoints.empty()) {
      CV_Error(cv::Error::StsNotImplemented,
               "keypoints from elsewhere cannot be described; expected detectAndCompute, which "
               "finds and describes them at once");
    }
    descriptors.release();
  }

  OrbExtractor extractor_;
  Features features_;
};

}  // namespace

cv::Ptr<cv::Feature2D> createFeature2D(const OrbOptions& options) {
  return cv::makePtr<OrbFeature2D>(options);
}

}  // namespace ktgp_orb
