#pragma once

#include <ros/callback_queue.h>
#include <ros/spinner.h>

#include <boost/make_shared.hpp>
#include <functional>
#include <utility>

namespace ktgp_orb {

/// A callback queue with its own thread.
///
/// A nodelet does not use the manager's threads for its callbacks: a manager's thread in a callback
/// keeps the nodelet alive, and would destroy it after the unloading has returned, when the other
/// callback queue no longer exists.
class CallbackThread {
 public:
  /// For ros::NodeHandle::setCallbackQueue. A queue that nobody uses gets no thread.
  ros::CallbackQueue* use() {
    is_used_ = true;
    return &callbacks_;
  }
  /// Calls `callback` once in this thread.
  void post(std::function<void()> callback) {
    callbacks_.addCallback(boost::make_shared<Once>(std::move(callback)));
  }
  void start() {
    if (is_used_) spinner_.start();
  }
  /// Ends all callbacks: a disabled queue accepts no more of them, and stopping its spinner waits
  /// for the running one. Destroy what the callbacks use only after this.
  void stop() {
    callbacks_.disable();
    spinner_.stop();
  }

 private:
  struct Once : ros::CallbackInterface {
    explicit Once(std::function<void()> c) : callback(std::move(c)) {}
    CallResult call() override {
      callback();
      return Success;
    }
    std::function<void()> callback;
  };

  ros::CallbackQueue callbacks_;
  ros::AsyncSpinner spinner_{1, &callbacks_};
  bool is_used_ = false;
};

}  // namespace ktgp_orb
