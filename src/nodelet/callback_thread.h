#pragma once

#include <ros/callback_queue.h>
#include <ros/spinner.h>

namespace ktgp_orb {

/// A callback queue with its own thread.
///
/// A nodelet does not use the manager's threads for its callbacks: a manager's thread in a callback
/// keeps the nodelet alive, and would destroy it after the unloading has returned, when the other
/// callback queue no longer exists.
struct CallbackThread {
  ros::CallbackQueue callbacks;
  ros::AsyncSpinner spinner{1, &callbacks};

  void start() { spinner.start(); }
  /// Ends all callbacks: a disabled queue accepts no more of them, and stopping its spinner waits
  /// for the running one. Destroy what the callbacks use only after this.
  void stop() {
    callbacks.disable();
    spinner.stop();
  }
};

}  // namespace ktgp_orb
