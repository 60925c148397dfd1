// The main() of the programs that load nodelets into their own process: a node of the program's
// name, whose own callbacks need only one thread.

#include "robot_testing.h"

int main(int argc, char** argv) {
  testing::InitGoogleTest(&argc, argv);
  ktgp_orb::test::arguments.assign(argv, argv + argc);
  const std::string path = argv[0];
  ros::init(argc, argv, path.substr(path.rfind('/') + 1));
  const ros::NodeHandle node;  // keeps ROS up between the tests
  ros::AsyncSpinner spinner(1);
  spinner.start();
  return RUN_ALL_TESTS();
}
