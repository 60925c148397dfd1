#include <ktgp_orb/HomographyStamped.h>
#include <ros/ros.h>

void print(const ktgp_orb::HomographyStamped& h) {
  if (h.status != h.STATUS_OK) return;  // there is no homography; status and reason say why
  ROS_INFO("the top-left pixel moved by %.2f, %.2f px", h.homography[2], h.homography[5]);
}

int main(int argc, char** argv) {
  ros::init(argc, argv, "print_motion");
  ros::NodeHandle node;
  const ros::Subscriber subscriber = node.subscribe("/usb_cam/matcher/homography", 10, print);
  ros::spin();
}
