// The matcher as a standalone program, which loads the same nodelet as a nodelet manager does.

#include <nodelet/loader.h>
#include <ros/ros.h>

#include <exception>
#include <opencv2/core/utility.hpp>

int main(int argc, char** argv) {
  ros::init(argc, argv, "matcher");
  // OpenCV needs no threads, since the matcher has its own; a nodelet in a manager does not change
  // this setting
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
