#include <ktgp_orb/HomographyStamped.h>
#include <ktgp_orb/MatchStatus.h>
#include <ros/ros.h>

void print(const ktgp_orb::HomographyStamped& h) {
  if (h.status != ktgp_orb::MatchStatus::STATUS_OK) return;  // see h.status and h.reason
  ROS_INFO("the top-left pixel moved by %.2f, %.2f px", h.homography[2], h.homography[5]);
}

int main(int argc, char** argv) {
  ros::init(argc, argv, "print_motion");
  ros::NodeHandle node;
  const ros::Subscriber subscriber = node.subscribe("/camera/matcher/homography", 10, print);
  ros::spin();
}
