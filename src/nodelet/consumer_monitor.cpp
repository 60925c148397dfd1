#include "nodelet/consumer_monitor.h"

namespace ktgp_orb {
namespace {

using diagnostic_msgs::DiagnosticStatus;
using Lock = std::lock_guard<std::mutex>;

constexpr int kPatience = 3;  // s

}  // namespace

void ConsumerMonitor::setTopics(const std::string& image, const std::string& homography) {
  const Lock lock(mutex_);
  image_topic_ = image;
  homography_topic_ = homography;
}

void ConsumerMonitor::setListening(bool listening) {
  const Lock lock(mutex_);
  listening_ = listening;
  silent_images_ = silent_homographies_ = 0;
}

void ConsumerMonitor::imageArrived() {
  const Lock lock(mutex_);
  ++total_.images;
}

void ConsumerMonitor::homographyArrived(bool found) {
  const Lock lock(mutex_);
  ++total_.homographies;
  if (found) ++total_.found;
}

void ConsumerMonitor::dropped(std::size_t count) {
  const Lock lock(mutex_);
  total_.dropped += count;
}

void ConsumerMonitor::refused(const std::string& reason) {
  const Lock lock(mutex_);
  ++total_.refused;
  refusal_ = reason;
}

void ConsumerMonitor::done(double milliseconds) {
  const Lock lock(mutex_);
  ++total_.done;
  total_.milliseconds += milliseconds;
}

void ConsumerMonitor::setWarning(const std::string& warning) {
  const Lock lock(mutex_);
  warning_ = warning;
}

void ConsumerMonitor::setValue(const std::string& name, const std::string& value) {
  const Lock lock(mutex_);
  values_[name] = value;
}

std::uint64_t ConsumerMonitor::images() const {
  const Lock lock(mutex_);
  return total_.images;
}

void ConsumerMonitor::tick() {
  const Lock lock(mutex_);
  last_.images = total_.images - before_.images;
  last_.homographies = total_.homographies - before_.homographies;
  last_.refused = total_.refused - before_.refused;
  last_.done = total_.done - before_.done;
  last_.milliseconds = total_.milliseconds - before_.milliseconds;
  before_ = total_;
  silent_images_ = last_.images > 0 ? 0 : silent_images_ + 1;
  silent_homographies_ = last_.homographies > 0 ? 0 : silent_homographies_ + 1;
}

void ConsumerMonitor::report(diagnostic_updater::DiagnosticStatusWrapper& report) {
  const Lock lock(mutex_);
  report.summary(DiagnosticStatus::OK, "works");
  if (!listening_) {
    report.summary(DiagnosticStatus::OK, "idle: no subscriber on any output");
  } else if (last_.refused > 0) {
    report.summary(DiagnosticStatus::ERROR, "images refused: " + refusal_);
  } else if (silent_images_ > kPatience) {
    report.summary(DiagnosticStatus::WARN, "no image on " + image_topic_);
  } else if (silent_homographies_ > kPatience) {
    report.summary(DiagnosticStatus::WARN,
                   "no homography on " + homography_topic_ + ": does the matcher run?");
  } else if (!warning_.empty()) {
    report.summary(DiagnosticStatus::WARN, warning_);
  }
  report.add("images", total_.images);
  report.add("homographies", total_.homographies);
  report.add("homographies found", total_.found);
  report.add("frames done", total_.done);
  report.add("dropped", total_.dropped);
  report.add("refused", total_.refused);
  report.addf("per frame (ms)", "%.2f",
              last_.done > 0 ? last_.milliseconds / static_cast<double>(last_.done) : 0.0);
  for (const auto& [name, value] : values_) report.add(name, value);
}

}  // namespace ktgp_orb
