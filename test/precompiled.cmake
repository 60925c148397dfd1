# The tests are compiled with little optimisation, so most of their time goes into reading the headers of OpenCV, Eigen
# and ROS. These are precompiled, once for tests without ROS and once for those with it: ten test files took 115 s in
# place of 131 s. For the libraries and programs this does not pay: their files then also instantiate the inline
# functions of headers that they do not use. Without precompiled headers the demo takes about 750 s of a processor to
# build, with them 916 s (g++ 12, two threads of a core).
#catkin_lint: ignore cmake_old
set(ktgp_orb_core_headers
  <algorithm> <array> <chrono> <cmath> <cstdint> <cstring> <functional> <limits> <map> <memory> <mutex>
  <numeric> <optional> <set> <sstream> <stdexcept> <string> <utility> <vector>
  <Eigen/Core> <Eigen/Cholesky> <Eigen/Eigenvalues> <Eigen/Geometry> <Eigen/LU>
  <opencv2/core.hpp> <opencv2/core/eigen.hpp> <opencv2/calib3d.hpp> <opencv2/features2d.hpp>
  <opencv2/imgproc.hpp>)
set(ktgp_orb_ros_headers
  <boost/make_shared.hpp> <cv_bridge/cv_bridge.h> <ros/ros.h> <sensor_msgs/CameraInfo.h>
  <sensor_msgs/CompressedImage.h> <sensor_msgs/Image.h> <sensor_msgs/image_encodings.h>)
set(ktgp_orb_precompiles ${KTGP_ORB_JOIN_FILES})
if(CMAKE_VERSION VERSION_LESS 3.16)
  set(ktgp_orb_precompiles OFF)
endif()

# ktgp_orb_precompiled_set(name [ROS] [HEADERS ...] [LIBRARIES ...]): a target that owns only what test programs share:
# the headers of the core, with ROS those of ROS, and HEADERS. A file that needs no ROS compiles 2 to 5 s longer with
# its headers: their inline functions instantiate templates.
function(ktgp_orb_precompiled_set name)
  cmake_parse_arguments(own "ROS" "" "HEADERS;LIBRARIES" ${ARGN})
  if(NOT ktgp_orb_precompiles)
    return()
  endif()
  file(WRITE ${PROJECT_BINARY_DIR}/${name}.cpp "")
  add_library(${name} OBJECT EXCLUDE_FROM_ALL ${PROJECT_BINARY_DIR}/${name}.cpp)
  target_link_libraries(${name} PRIVATE ktgp_orb_core ktgp_orb_warnings ${own_LIBRARIES})
  if(own_ROS AND NOT KTGP_ORB_CORE_ONLY)
    list(APPEND own_HEADERS ${ktgp_orb_ros_headers})
    target_include_directories(${name} SYSTEM PRIVATE ${catkin_INCLUDE_DIRS})
  endif()
  target_precompile_headers(${name} PRIVATE ${ktgp_orb_core_headers} ${own_HEADERS})
endfunction()

# ktgp_orb_reuse_precompiled(owner TARGETS ...): their compiler flags are those of the owner.
function(ktgp_orb_reuse_precompiled owner)
  if(ktgp_orb_precompiles)
    foreach(target ${ARGN})
      target_precompile_headers(${target} REUSE_FROM ${owner})
    endforeach()
  endif()
endfunction()
