#include "nodelet/image_node.h"

#include <malloc.h>

#include <algorithm>
#include <exception>

#include "ros/image_conversion.h"
#include "util/format.h"

namespace ktgp_orb {
namespace {

using Lock = std::lock_guard<std::mutex>;

constexpr int kSilence = 3;  // s; an input is silent after this time without a message

/// Returns true if ROS time is simulated and its clock never started.
bool clockIsMissing() {
  return ros::Time::isSimTime() && ros::Time::now().isZero();
}

}  // namespace

void NodeBase::onInit() {
  try {
    start();
    diagnosis_.open(getName(), inputs_.front()->what(), inputs_.front()->topic(), workName());
    const ros::NodeHandle connections = privateNode(settings_queue_);
    outputs_.open(connections, [this] { connectionsChanged(); });
    updater_ =
        std::make_unique<diagnostic_updater::Updater>(node(slow_queue_), connections, getName());
    diagnosis_.add(*updater_);
    {
      // Hold the lock until all outputs are advertised, so that an early subscriber finds all of
      // them.
      const Lock lock(connect_mutex_);
      advertise();
      connected_ = true;
    }
    addTimer(slow_queue_, 1.0, [this] { tick(); });
  } catch (const std::exception& error) {
    // The loader catches the exception but does not print its text.
    NODELET_FATAL("%s", error.what());
    throw;
  }
  NODELET_INFO("%s", greeting().c_str());
  for (CallbackThread* queue :
       {&settings_queue_, &data_queue_, &service_queue_, &long_queue_, &slow_queue_}) {
    queue->start();
  }
  connectionsChanged();
}

void NodeBase::giveMemoryBack() {
#ifdef __GLIBC__
  malloc_trim(0);
#endif
}

void NodeBase::stop() {
  for (CallbackThread* queue :
       {&settings_queue_, &data_queue_, &service_queue_, &long_queue_, &slow_queue_}) {
    queue->stop();
  }
  stopWorker();
  for (ros::WallTimer& timer : timers_) timer.stop();
  for (ros::ServiceServer& service : services_) service.shutdown();
  stopParameters();
  {
    const Lock lock(connect_mutex_);
    connected_ = false;
    for (const auto& input : inputs_) input->subscribe(false);
  }
  outputs_.shutdown();
  updater_.reset();
  // glibc gives each thread its own arena and keeps the memory that is freed there. Without this
  // call, a manager's memory grew by about 0.5 MB each time a nodelet was reloaded.
  giveMemoryBack();
}

ros::NodeHandle NodeBase::node(CallbackThread& queue) const {
  ros::NodeHandle node = getNodeHandle();
  node.setCallbackQueue(queue.use());
  return node;
}

ros::NodeHandle NodeBase::privateNode(CallbackThread& queue) const {
  ros::NodeHandle node = getPrivateNodeHandle();
  node.setCallbackQueue(queue.use());
  return node;
}

ImageInput& NodeBase::addImages(int queue_size, ImageInput::Callback callback) {
  const auto arrived = [this, callback = std::move(callback)](
                           const sensor_msgs::ImageConstPtr& image, std::uint32_t lost) {
    diagnosis_.arrived();
    const ImageStamps::Wrong wrong = stamps_.wrongWith(image->header.stamp, ros::Time::now());
    if (wrong != ImageStamps::Wrong::nothing) diagnosis_.count(ImageStamps::nameOf(wrong));
    if (stamps_.wrong() != last_wrong_) {
      last_wrong_ = stamps_.wrong();
      diagnosis_.setValue("last wrong stamp", std::to_string(last_wrong_.toSec()));
    }
    if (wrong == ImageStamps::Wrong::ahead) return diagnosis_.refuse(stamps_.reason());
    if (lost > 0 && !paused_) diagnosis_.count(Diagnosis::kLost, lost);
    callback(image, lost);
  };
  auto input = std::make_unique<ImageInput>(node(data_queue_), privateNode(data_queue_), queue_size,
                                            arrived);
  ImageInput& added = *input;
  inputs_.push_back(std::move(input));
  return added;
}

// Uses wall time, so that the timers keep running while a bag that is played with --clock is
// paused.
ros::WallTimer NodeBase::addTimer(CallbackThread& queue, double period,
                                  const std::function<void()>& tick) {
  timers_.push_back(node(queue).createWallTimer(ros::WallDuration(period),
                                                [tick](const ros::WallTimerEvent&) { tick(); }));
  return timers_.back();
}

void NodeBase::connectionsChanged() {
  const Lock lock(connect_mutex_);
  if (!connected_) return;
  const bool wanted = isWanted();
  const bool changed = wanted != listening_;
  listening_ = wanted;
  if (changed && wanted) listeningChanged(true);
  for (const auto& input : inputs_) input->subscribe(wanted);
  if (changed) diagnosis_.setListening(wanted);
  if (changed && !wanted) listeningChanged(false);
}

/// Reports a frame that was lost because its job threw an exception, for example when memory ran
/// out. The nodelet goes on, since the next frame may work.
void NodeBase::failed(const std::exception& error) {
  const bool is_refusal = dynamic_cast<const RefusedImage*>(&error) != nullptr;
  diagnosis_.refuse((is_refusal ? "" : "frame lost: ") + std::string(error.what()));
}

void NodeBase::tick() {
  const ros::Time now = ros::Time::now();
  const bool stands = ros::Time::isSimTime() && now == std::exchange(last_time_, now);
  watchInputs(stands);
  diagnosis_.tick(stands, clockIsMissing());
  reportStamps();
  reportRepeats();
  beforeReport();
  updater_->force_update();
}

/// Reports wrong stamps only if there are several, because a single wrong stamp is harmless: it
/// occurs when a bag is looped.
void NodeBase::reportStamps() {
  constexpr std::uint64_t kSome = 3;  // fewer wrong stamps in ten seconds are not reported
  std::string text;
  using Wrong = ImageStamps::Wrong;
  for (const Wrong each : {Wrong::zero, Wrong::again, Wrong::back, Wrong::ahead}) {
    const char* const wrong = ImageStamps::nameOf(each);
    const std::uint64_t number = diagnosis_.recent(wrong);
    if (number < kSome) continue;
    text = std::to_string(number) + " images in ten seconds have " + wrong +
           ": results are found by header.stamp, and a velocity needs it; the driver should give "
           "each image the time of its exposure";
    break;
  }
  diagnosis_.setProblem("stamps", text);
}

void NodeBase::reportRepeats() {
  constexpr double kMost = 0.1;  // a larger share of repeated images is reported
  // Up to this many repeats in ten seconds are not reported: when a camera stops, its images count
  // as repeats until Repeats detects the standstill.
  constexpr double kByStop = 10.0;
  const auto repeated = static_cast<double>(diagnosis_.recent(Diagnosis::kRepeated));
  const double images = repeated + static_cast<double>(diagnosis_.recent(Diagnosis::kDone));
  const bool often = repeated > std::max(kByStop, kMost * images);
  diagnosis_.setProblem("repeats",
                        often ? util::format("images repeat: %.0f of the last %.0f are the image "
                                             "before once more; they are no new frames",
                                             repeated, images)
                              : "");
}

void NodeBase::watchInputs(bool clock_stands) {
  std::string silence;
  std::string mixture;
  for (const auto& input : inputs_) {
    InputWatch& watch = input->watch();
    std::uint32_t publishers = 0;
    bool listening = false;
    {
      const Lock lock(connect_mutex_);
      listening = listening_;
      if (listening) publishers = input->publishers();
    }
    input->setPublishers(publishers);
    if (mixture.empty()) mixture = watch.mixture(publishers);
    if (input->mayBeSilent()) continue;
    // Do not report silence while a bag is paused, or before bag.launch plays its bag (bag.launch
    // sets this parameter). In all other cases report silence, even if the clock never started.
    if (clock_stands && (!clockIsMissing() || ros::param::has("/ktgp_orb_plays_a_bag"))) continue;
    const std::string warning = watch.tick(listening, input->arrived(), publishers);
    if (!warning.empty()) NODELET_WARN("%s", warning.c_str());
    if (silence.empty() && watch.silentSeconds() > kSilence) {
      silence = noneOn(input->what(), input->topic(), watch.trouble());
    }
  }
  diagnosis_.setInput(silence, mixture);
}

}  // namespace ktgp_orb
