# Each file that includes OpenCV, Eigen or ROS spends 1 to 5 s on reading them. These headers are
# compiled once for each set of compiler flags: the core, the shared ROS libraries, programs, tests.
# With -DKTGP_ORB_PRECOMPILE=OFF each file reads its own headers, and fails if it does not include enough.
#catkin_lint: ignore cmake_old
option(KTGP_ORB_PRECOMPILE "Precompile the headers of other libraries (needs CMake 3.16)" ON)
if(CMAKE_VERSION VERSION_LESS 3.16 OR KTGP_ORB_FUZZ)
  set(KTGP_ORB_PRECOMPILE OFF)  # the fuzz targets have their own precompiled headers
endif()

set(ktgp_orb_core_headers
  <algorithm> <array> <chrono> <cmath> <cstdint> <cstring> <functional> <limits> <map> <memory> <mutex>
  <numeric> <optional> <set> <sstream> <stdexcept> <string> <utility> <vector>
  <Eigen/Core> <Eigen/Cholesky> <Eigen/Eigenvalues> <Eigen/Geometry> <Eigen/LU>
  <opencv2/core.hpp> <opencv2/core/eigen.hpp> <opencv2/calib3d.hpp> <opencv2/features2d.hpp>
  <opencv2/imgproc.hpp>)
set(ktgp_orb_ros_headers
  <boost/make_shared.hpp> <cv_bridge/cv_bridge.h> <ros/ros.h> <sensor_msgs/CameraInfo.h>
  <sensor_msgs/CompressedImage.h> <sensor_msgs/Image.h> <sensor_msgs/image_encodings.h>)
set(ktgp_orb_nodelet_headers
  <diagnostic_updater/diagnostic_updater.h> <dynamic_reconfigure/server.h>
  <image_transport/image_transport.h> <nodelet/nodelet.h>)

# ktgp_orb_precompile(target HEADERS ...)
function(ktgp_orb_precompile target)
  if(KTGP_ORB_PRECOMPILE)
    target_precompile_headers(${target} PRIVATE ${ARGN})
    # CMake defines a macro with the target's name in shared libraries; with it others could not use the headers.
    set_target_properties(${target} PROPERTIES DEFINE_SYMBOL "")
  endif()
endfunction()

# ktgp_orb_reuse_precompiled(owner TARGETS ...): their compiler flags are those of the owner.
function(ktgp_orb_reuse_precompiled owner)
  if(KTGP_ORB_PRECOMPILE)
    foreach(target ${ARGN})
      target_precompile_headers(${target} REUSE_FROM ${owner})
    endforeach()
  endif()
endfunction()

# ktgp_orb_precompiled_set(name [ROS] [HEADERS ...] [LIBRARIES ...]): a target that owns only what
# programs share: the headers of the core, with ROS those of ROS, and HEADERS. A file that needs no ROS compiles 2 to
# 5 s longer with its headers: their inline functions instantiate templates.
function(ktgp_orb_precompiled_set name)
  cmake_parse_arguments(own "ROS" "" "HEADERS;LIBRARIES" ${ARGN})
  if(NOT KTGP_ORB_PRECOMPILE)
    return()
  endif()
  file(WRITE ${PROJECT_BINARY_DIR}/${name}.cpp "")
  add_library(${name} OBJECT EXCLUDE_FROM_ALL ${PROJECT_BINARY_DIR}/${name}.cpp)
  target_link_libraries(${name} PRIVATE ktgp_orb_core ktgp_orb_warnings ${own_LIBRARIES})
  if(own_ROS AND NOT KTGP_ORB_CORE_ONLY)
    list(APPEND own_HEADERS ${ktgp_orb_ros_headers})
    target_include_directories(${name} SYSTEM PRIVATE ${catkin_INCLUDE_DIRS})
  endif()
  ktgp_orb_precompile(${name} ${ktgp_orb_core_headers} ${own_HEADERS})
endfunction()

# ktgp_orb_precompiled_programs(): for programs, and the static libraries within them. Without CLI11: its
# constants cost each file 4 s of code generation, and few files need it.
function(ktgp_orb_precompiled_programs)
  set(headers "")
  set(libraries "")
  if(NOT KTGP_ORB_CORE_ONLY)
    list(APPEND headers <rosbag/bag.h>)
  endif()
  if(TARGET nlohmann_json::nlohmann_json)
    list(APPEND headers <nlohmann/json.hpp>)
    list(APPEND libraries nlohmann_json::nlohmann_json)
  endif()
  ktgp_orb_precompiled_set(ktgp_orb_program_headers ROS HEADERS ${headers} LIBRARIES ${libraries})
endfunction()
