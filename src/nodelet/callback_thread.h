#pragma once

#include <ros/callback_queue.h>
#include <ros/spinner.h>

#include <boost/make_shared.hpp>
#include <functional>
#include <utility>

namespace ktgp_orb {

/// A callback queue with its own thread.
///
/// The nodelets run their callbacks here and not in the manager's threads, because a manager thread
/// holds a reference to the nodelet during a callback. If the nodelet were unloaded during the
/// callback, the manager thread would release the last reference and destroy the nodelet after the
/// manager has deleted the nodelet's callback queues. Also, roscpp blocks all signals in this
/// thread (ros::AsyncSpinner), so a file beyond the limit of ulimit -f is an error and not the
/// signal SIGXFSZ, which would end the process.
class CallbackThread {
 public:
  /// Returns the queue for ros::NodeHandle::setCallbackQueue(). start() starts the thread only if
  /// use() was called before.
  ros::CallbackQueue* use() {
    is_used_ = true;
    return &callbacks_;
  }
  /// Calls `callback` once in the thread of this queue.
  void post(std::function<void()> callback) {
    callbacks_.addCallback(boost::make_shared<Once>(std::move(callback)));
  }
  void start() {
    if (is_used_) spinner_.start();
  }
  /// Ends all callbacks: a disabled queue accepts no more callbacks, and stopping its spinner waits
  /// for the running callback. Call this before you destroy anything that the callbacks use.
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
