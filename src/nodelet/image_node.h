#pragma once

#include <diagnostic_updater/diagnostic_updater.h>
#include <dynamic_reconfigure/server.h>
#include <nodelet/nodelet.h>
#include <ros/ros.h>

#include <atomic>
#include <boost/thread/recursive_mutex.hpp>
#include <functional>
#include <memory>
#include <mutex>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "nodelet/callback_thread.h"
#include "nodelet/diagnosis.h"
#include "nodelet/input.h"
#include "nodelet/outputs.h"
#include "nodelet/parameters.h"
#include "nodelet/worker.h"
#include "ros/image_stamps.h"
#include "util/printable.h"

namespace ktgp_orb {

/// Base class of ImageNode, with everything that does not depend on its template parameters. It
/// provides outputs, services, diagnostics, inputs that are subscribed only while somebody wants
/// results, and a shutdown that is safe at any time.
///
/// Callbacks run in queues of the nodelet, not in the manager's; each queue has a thread:
///   settings_queue_  parameters, connections, and inputs that change settings
///   data_queue_      inputs whose messages go to the worker
///   service_queue_   services that only send a job to the worker
///   long_queue_      services that do their work themselves
///   slow_queue_      diagnostics and input watches; both may wait for the ROS master
class NodeBase : public nodelet::Nodelet {
 protected:
  /// Adds the inputs and reads the parameters. If this throws, the nodelet is not loaded, and users
  /// see the text of the exception.
  virtual void start() = 0;
  /// Advertises outputs and services, and starts the worker.
  virtual void advertise() = 0;
  virtual void stopWorker() = 0;
  virtual void stopParameters() = 0;
  /// Name under which parametersOf() finds the parameters of this nodelet.
  virtual std::string nodelet() const = 0;
  /// Name of the diagnostics entry that reports on the work (see Diagnosis).
  virtual std::string workName() const = 0;
  /// Text for the log at start. It says what the nodelet does, and with which inputs.
  virtual std::string greeting() const = 0;
  /// Returns true while results are wanted.
  virtual bool isWanted() const { return outputs_.haveSubscribers(); }
  /// Called after the inputs were subscribed or unsubscribed.
  virtual void listeningChanged(bool /*listening*/) {}
  /// Called in the slow queue once a second, before the reports.
  virtual void beforeReport() {}

  /// Call this first in the destructor of each nodelet, since callbacks use the nodelet's members.
  /// Destroying a dynamic_reconfigure server during a callback would crash the manager.
  void stop();

  ros::NodeHandle node(CallbackThread& queue) const;
  ros::NodeHandle privateNode(CallbackThread& queue) const;
  /// Adds an input of images. The diagnostics entry "input" is about the first input that was
  /// added.
  ImageInput& addImages(int queue_size, ImageInput::Callback callback);
  template <typename Message>
  Input& addInput(const std::string& name, const std::string& what, std::uint32_t queue_size,
                  bool is_watched, typename MessageInput<Message>::Callback callback,
                  CallbackThread* queue = nullptr) {
    inputs_.push_back(
        std::make_unique<MessageInput<Message>>(node(queue != nullptr ? *queue : data_queue_), name,
                                                what, queue_size, is_watched, std::move(callback)));
    return *inputs_.back();
  }
  /// Adds a service; `answer` fills the response. If `answer` throws, the response has success =
  /// false and the text of the exception as its message.
  template <typename Service>
  void addService(
      const std::string& name, CallbackThread& queue,
      const std::function<void(typename Service::Request&, typename Service::Response&)>& answer) {
    using Callback = boost::function<bool(typename Service::Request&, typename Service::Response&)>;
    ros::NodeHandle node = privateNode(queue);
    services_.push_back(node.advertiseService(
        name, Callback([this, answer](auto& request, auto& response) {
          try {
            response.success = true;
            answer(request, response);
          } catch (const std::exception& error) {
            response.success = false;
            response.message = util::printable(error.what(), 600);
            NODELET_WARN("a request is refused: %s", response.message.c_str());
          }
          if (ros::serialization::serializationLength(request) > kLargeRequest) giveMemoryBack();
          return true;
        })));
  }
  ros::WallTimer addTimer(CallbackThread& queue, double period, const std::function<void()>& tick);

  /// Subscribes or unsubscribes the inputs as needed; does nothing before the outputs are
  /// advertised.
  void connectionsChanged();
  bool isListening() const { return listening_; }
  void failed(const std::exception& error);

  std::atomic<bool> paused_{false};  // while true, images are ignored

  CallbackThread settings_queue_;
  CallbackThread data_queue_;
  CallbackThread service_queue_;
  CallbackThread long_queue_;
  CallbackThread slow_queue_;
  Diagnosis diagnosis_;
  Outputs outputs_;

 private:
  static constexpr std::uint32_t kLargeRequest = 4'000'000;  // bytes

  void onInit() final;
  void tick();
  /// Gives freed memory back to the system; otherwise the allocator would keep it.
  static void giveMemoryBack();
  void watchInputs(bool clock_stands);
  void reportStamps();
  void reportRepeats();

  std::vector<std::unique_ptr<Input>> inputs_;
  std::vector<ros::ServiceServer> services_;
  std::vector<ros::WallTimer> timers_;
  std::unique_ptr<diagnostic_updater::Updater> updater_;
  std::mutex connect_mutex_;  // guards connected_, and the subscriptions of inputs_
  bool connected_ = false;
  std::atomic<bool> listening_{false};
  ros::Time last_time_;                   // used only in the slow queue
  ImageStamps stamps_;                    // used only in the data queue, like last_wrong_
  ros::Time last_wrong_ = ros::TIME_MAX;  // the wrong stamp that the diagnostics show now
};

/// A nodelet with the parameters `Config`, and a worker with the state `Work`.
template <typename Config, typename Work>
class ImageNode : public NodeBase {
 protected:
  /// Applies new parameters, and may adjust them. Called in the settings queue. If it throws
  /// std::exception, it must not have changed anything, and the old parameters stay.
  virtual void configure(Config& config) = 0;

  /// Reads the parameters and starts the dynamic_reconfigure server, with which users can change
  /// them. Throws std::invalid_argument if the parameters are unusable. If a user sets bad
  /// parameters later, refuses them and gives the reason in the log and the diagnostics.
  void serveParameters() {
    const ros::NodeHandle node = privateNode(settings_queue_);
    requireUsable(node, nodelet());
    for (const std::string& warning : warningsOfUnknown(node, nodelet())) {
      NODELET_WARN("%s", warning.c_str());
    }
    server_ = std::make_unique<dynamic_reconfigure::Server<Config>>(server_mutex_, node);
    server_->setCallback([this](Config& config, std::uint32_t /*level*/) {
      try {
        requireUsable(config, nodelet());
        configure(config);
        config_ = config;
        is_configured_ = true;
        diagnosis_.setFault("parameters", "");
        diagnosis_.setValue("refused parameters", "");
      } catch (const std::exception& error) {
        if (!is_configured_) {
          first_refusal_ = error.what();  // do not throw here: dynamic_reconfigure drops exceptions
          return;
        }
        refuseParameters(error.what());
        config = config_;
      }
    });
    if (!is_configured_) {
      throw std::invalid_argument(
          "the parameters of " + node.getNamespace() + " cannot be used: " + first_refusal_ +
          ". Set others, or remove them with 'rosparam delete " + node.getNamespace() + "'");
    }
  }
  void refuseParameters(const std::string& reason) {
    diagnosis_.setFault("parameters", "parameters refused: " + reason, false);
    diagnosis_.setValue("refused parameters", util::printable(reason, 600));
    NODELET_ERROR("new parameters are refused, the old ones stay: %s",
                  util::printable(reason, 600).c_str());
  }
  void startWorker(std::unique_ptr<Work> work, typename Worker<Work>::Job afterwards = nullptr) {
    worker_.start(
        std::move(work), [this](const std::exception& error) { failed(error); },
        std::move(afterwards));
  }
  bool isConfigured() const { return is_configured_; }
  void stopWorker() override { worker_.stop(); }
  void stopParameters() override { server_.reset(); }

  Config config_;  // used only in the settings queue
  Worker<Work> worker_;

 private:
  boost::recursive_mutex server_mutex_;
  std::unique_ptr<dynamic_reconfigure::Server<Config>> server_;
  bool is_configured_ = false;
  std::string first_refusal_;
};

}  // namespace ktgp_orb
