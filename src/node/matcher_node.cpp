// The matcher as a program of its own. It loads the same nodelet that a nodelet manager would load.

#include <nodelet/loader.h>
#include <ros/ros.h>

#include <exception>
#include <opencv2/core/utility.hpp>

int main(int argc, char** argv) {
  ros::init(argc, argv, "matcher");
  // OpenCV needs no threads here, because the matcher has its own. Only this program changes the
  // setting: in a nodelet manager, it would affect other nodelets.
  cv::setNumThreads(1);
  try {
    nodelet::Loader loader;
    const bool loaded = loader.load(ros::this_node::getName(), "ktgp_orb/matcher",
                                    ros::names::getRemappings(), nodelet::V_string());
    if (!loaded) {
      ROS_FATAL(
          "nodelet ktgp_orb/matcher does not start; if no reason is given above: is "
          "the workspace sourced?");
      return 1;
    }
    ros::spin();
  } catch (const std::exception& /*reported by the nodelet*/) {
    return 1;
  }
  return 0;
}
