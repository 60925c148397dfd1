#pragma once

#include <ktgp_orb/HomographyStamped.h>
#include <ktgp_orb/MatchStatus.h>

#include <cstddef>
#include <memory>
#include <optional>
#include <string>
#include <utility>

#include "nodelet/image_node.h"
#include "nodelet/image_store.h"
#include "ros/camera.h"
#include "ros/image_conversion.h"

namespace ktgp_orb {

/// Base class of the nodelets that use images and the matcher's homographies. `Work` keeps each
/// image in an ImageStore until its homography arrives. `Work` needs these functions:
///   add(image), follow(homography)   called for each image or homography that arrives
///   finish()                         called when everything that has arrived was added
///   restart()                        called after the inputs were unsubscribed
template <typename Config, typename Work>
class FrameConsumer : public ImageNode<Config, Work> {
 protected:
  static constexpr std::size_t kImage = 1;  // kinds of jobs of the worker
  static constexpr std::size_t kHomography = 2;

  void start() override {
    images_ = &this->addImages(5, [this](const sensor_msgs::ImageConstPtr& image, std::uint32_t) {
      if (image->header.stamp.isZero()) {
        this->diagnosis_.refuse("its header.stamp is zero, so its homography cannot be found");
        return;
      }
      try {
        requirePixels(*image);
      } catch (const RefusedImage& error) {
        this->diagnosis_.refuse(error.what());
        return;
      }
      this->diagnosis_.count(Diagnosis::kDropped, this->worker_.template put<&Work::add>(
                                                      kImage, image->data.size(), image));
    });
    this->worker_.setLimits(kImage, 10, ImageStore::kBytes / 2);
    // The homographies form a chain from frame to frame. So that none is lost, many of them may
    // wait.
    homographies_ = &this->template addInput<HomographyStamped>(
        "homography", "homography", 100, true,
        [this](const HomographyStampedConstPtr& message) { arrived(message); });
    this->worker_.setLimits(kHomography, 300);
    addOwnInputs();
    this->serveParameters();
  }

  /// Override this to add more inputs. Give each input its own kind of job.
  virtual void addOwnInputs() {}

  void startWorker(std::unique_ptr<Work> work) {
    ImageNode<Config, Work>::startWorker(std::move(work), [](Work& state) { state.finish(); });
  }
  std::string workName() const override { return "frames"; }
  std::string greeting() const override {
    return "takes images on " + images_->topic() + " (transport " + images_->transport() +
           ") and homographies on " + homographies_->topic();
  }
  void listeningChanged(bool listening) override {
    if (listening) return;
    this->worker_.clear(kImage);
    this->worker_.clear(kHomography);
    this->worker_.post([](Work& work) { work.restart(); });
  }

  ImageInput* images_ = nullptr;
  Input* homographies_ = nullptr;

 private:
  void arrived(const HomographyStampedConstPtr& message) {
    const std::string mixture = mixtureOf(*message);
    this->diagnosis_.setProblem("pixels", mixture);
    if (!mixture.empty()) return;
    this->diagnosis_.count("homographies");
    this->diagnosis_.count("homographies found", message->status == MatchStatus::STATUS_OK ? 1 : 0);
    this->worker_.template put<&Work::follow>(kHomography, 0, message);
  }

  /// Returns an error text if the homographies are of raw images but the images are rectified, or
  /// vice versa. Returns an empty text if both are of the same kind, or if the name of the topic
  /// does not tell the kind.
  std::string mixtureOf(const HomographyStamped& message) const {
    const std::optional<Pixels> pixels = pixelsOf(images_->topic());
    if (!pixels || (*pixels == Pixels::rectified) == (message.rectified != 0)) return {};
    const char* const kinds[] = {"raw", "rectified"};
    const bool is_rectified = message.rectified != 0;
    return "the homographies on " + homographies_->topic() + " are of " + kinds[is_rectified] +
           " images, and do not fit the " + kinds[!is_rectified] + " ones on " + images_->topic() +
           ", which its name says they are; expected the same images for both (see the matcher's "
           "rectify and calibration), or a topic whose name tells their kind";
  }
};

}  // namespace ktgp_orb
