# The parts of a ROS package: messages, parameters, exports.
find_package(catkin REQUIRED COMPONENTS
  cv_bridge
  diagnostic_updater
  dynamic_reconfigure
  geometry_msgs
  image_transport
  message_generation
  nav_msgs
  nodelet
  pluginlib
  rosbag
  roscpp
  sensor_msgs
  std_msgs
  std_srvs
  tf2_ros
  visualization_msgs
)
include(cmake/messages.cmake)
generate_dynamic_reconfigure_options(
  cfg/GroundMotion.cfg cfg/Ktgp.cfg cfg/Mosaic.cfg cfg/Stabilizer.cfg
  cfg/Targets.cfg)
# Their inputs: after a change of a row the output is generated again.
foreach(pair GroundMotion=ground_motion Ktgp=table Mosaic=mosaic Stabilizer=stabilizer Targets=targets)
  string(REPLACE "=" ";" pair ${pair})
  list(GET pair 0 config)
  list(GET pair 1 table)
  add_custom_command(APPEND
    OUTPUT ${CATKIN_DEVEL_PREFIX}/${CATKIN_PACKAGE_INCLUDE_DESTINATION}/${config}Config.h
    DEPENDS ${PROJECT_SOURCE_DIR}/src/parameters/${table}.def ${PROJECT_SOURCE_DIR}/cfg/ktgp_table.py)
endforeach()

catkin_package(
  INCLUDE_DIRS include
  LIBRARIES ktgp_orb_core ktgp_orb_views ktgp_orb_messages ktgp_orb_nodelets
  CATKIN_DEPENDS
    cv_bridge diagnostic_updater dynamic_reconfigure geometry_msgs image_transport message_runtime
    nav_msgs nodelet pluginlib rosbag roscpp sensor_msgs std_msgs std_srvs tf2_ros visualization_msgs
  DEPENDS EIGEN3 OpenCV
  CFG_EXTRAS ktgp_orb-extras.cmake
)

# Installed programs are in lib/ktgp_orb, the libraries in lib; Debian's packages have them where the linker looks.
set(CMAKE_INSTALL_RPATH "$ORIGIN;$ORIGIN/..")
option(KTGP_ORB_CMAKE_PACKAGE "Install the CMake package for programs without ROS, too" OFF)
if(KTGP_ORB_CMAKE_PACKAGE)
  include(cmake/cmake_package.cmake)
endif()
install(DIRECTORY include/${PROJECT_NAME}/
  DESTINATION ${CATKIN_PACKAGE_INCLUDE_DESTINATION})
install(DIRECTORY config launch rviz
  DESTINATION ${CATKIN_PACKAGE_SHARE_DESTINATION})
# Their first line names /usr/bin/python3, which has ROS, for any python3 on PATH.
install(PROGRAMS scripts/camera_motion scripts/in_parent_namespace scripts/play_bag scripts/sliders
  scripts/start_rqt
  DESTINATION ${CATKIN_PACKAGE_BIN_DESTINATION})
# Launch files call it by its path in their own package.
#catkin_lint: ignore_once wrong_bin_install_destination
install(PROGRAMS scripts/keep_sim_time
  DESTINATION ${CATKIN_PACKAGE_SHARE_DESTINATION}/scripts)
install(FILES image_transport_plugins.xml nodelet_plugins.xml
  DESTINATION ${CATKIN_PACKAGE_SHARE_DESTINATION})
