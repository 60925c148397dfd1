#pragma once

#include <ros/callback_queue.h>
#include <ros/spinner.h>

namespace ktgp_orb {

/// A callback queue with a thread of its own.
///
/// A nodelet's callbacks do not run in the manager's threads: one of these that is in a callback
/// keeps the nodelet alive, and then it is that thread that destroys it, after the unloading has
/// returned and with the nodelet's other callback queue already gone.
struct CallbackThread {
  ros::CallbackQueue callbacks;
  ros::AsyncSpinner spinner{1, &callbacks};

  void start() { spinner.start(); }
  /// The end of all callbacks: a disabled queue takes no more of them, and stopping its spinner
  /// waits for the one that runs. What they use may go only then.
  void stop() {
    callbacks.disable();
    spinner.stop();
  }
};

}  // namespace ktgp_orb
