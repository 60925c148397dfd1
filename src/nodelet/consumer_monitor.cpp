#include "nodelet/consumer_monitor.h"

#include "nodelet/input_watch.h"

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

void ConsumerMonitor::forgotten(std::size_t count) {
  const Lock lock(mutex_);
  total_.forgotten += count;
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

void ConsumerMonitor::setParameterError(const std::string& error) {
  const Lock lock(mutex_);
  parameter_error_ = error;
}

void ConsumerMonitor::setMixture(const std::string& mixture) {
  const Lock lock(mutex_);
  mixture_ = mixture;
}

void ConsumerMonitor::setTroubles(const std::string& of_images,
                                  const std::string& of_homographies) {
  const Lock lock(mutex_);
  image_trouble_ = of_images;
  homography_trouble_ = of_homographies;
}

void ConsumerMonitor::setValue(const std::string& name, const std::string& value) {
  const Lock lock(mutex_);
  values_[name] = value;
}

std::uint64_t ConsumerMonitor::images() const {
  const Lock lock(mutex_);
  return total_.images;
}

std::uint64_t ConsumerMonitor::homographies() const {
  const Lock lock(mutex_);
  return total_.homographies;
}

std::uint64_t ConsumerMonitor::found() const {
  const Lock lock(mutex_);
  return total_.found;
}

void ConsumerMonitor::tick(bool clock_stands) {
  const Lock lock(mutex_);
  last_.images = total_.images - before_.images;
  last_.homographies = total_.homographies - before_.homographies;
  last_.refused = total_.refused - before_.refused;
  last_.forgotten = total_.forgotten - before_.forgotten;
  last_.done = total_.done - before_.done;
  last_.milliseconds = total_.milliseconds - before_.milliseconds;
  before_ = total_;
  clock_stands_ = clock_stands && last_.images == 0;
  if (clock_stands_) return;
  silent_images_ = last_.images > 0 ? 0 : silent_images_ + 1;
  silent_homographies_ = last_.homographies > 0 ? 0 : silent_homographies_ + 1;
}

void ConsumerMonitor::summarise(diagnostic_updater::DiagnosticStatusWrapper& report) const {
  const auto warn = [&report](const std::string& text) {
    report.summary(DiagnosticStatus::WARN, text);
  };
  report.summary(DiagnosticStatus::OK, "works");
  if (!parameter_error_.empty()) return warn("parameters refused: " + parameter_error_);
  if (!listening_) {
    report.summary(DiagnosticStatus::OK, "idle: no subscriber on any output");
  } else if (last_.refused > 0) {
    report.summary(DiagnosticStatus::ERROR, "images refused: " + refusal_);
  } else if (clock_stands_) {
    report.summary(DiagnosticStatus::OK,
                   "the clock stands: a paused bag, or /clock has no publisher");
  } else if (!mixture_.empty()) {
    warn(mixture_);
  } else if (silent_images_ > kPatience) {
    warn(noneOn("image", image_topic_, image_trouble_));
  } else if (silent_homographies_ > kPatience) {
    warn(noneOn("homography", homography_topic_,
                homography_trouble_.empty() ? "does the matcher run?" : homography_trouble_));
  } else if (last_.forgotten > 0) {
    warn("images were dropped before their homography arrived: max_memory is too small for them");
  } else if (!warning_.empty()) {
    warn(warning_);
  }
}

void ConsumerMonitor::report(diagnostic_updater::DiagnosticStatusWrapper& report) {
  const Lock lock(mutex_);
  summarise(report);
  report.add("images", total_.images);
  report.add("homographies", total_.homographies);
  report.add("homographies found", total_.found);
  report.add("frames done", total_.done);
  report.add("dropped", total_.dropped);
  report.add("dropped because of max_memory", total_.forgotten);
  report.add("refused", total_.refused);
  report.add("refused parameters", parameter_error_);
  report.addf("per frame (ms)", "%.2f",
              last_.done > 0 ? last_.milliseconds / static_cast<double>(last_.done) : 0.0);
  for (const auto& [name, value] : values_) report.add(name, value);
}

}  // namespace ktgp_orb
