# The library and its tools without ROS; GNU's folders replace those of catkin.
include(GNUInstallDirs)
#catkin_lint: ignore immutable_var
#catkin_lint: ignore wrong_install_destination
set(CATKIN_PACKAGE_LIB_DESTINATION ${CMAKE_INSTALL_LIBDIR})
set(CATKIN_GLOBAL_BIN_DESTINATION ${CMAKE_INSTALL_BINDIR})
set(CATKIN_PACKAGE_BIN_DESTINATION ${CMAKE_INSTALL_BINDIR})
option(BUILD_SHARED_LIBS "Build shared libraries, which are installed as a CMake package" ON)
option(CATKIN_ENABLE_TESTING "Build the tests" OFF)
enable_testing()
install(DIRECTORY include/${PROJECT_NAME}/ DESTINATION ${CMAKE_INSTALL_INCLUDEDIR}/${PROJECT_NAME})
# Installed programs find the libraries under any prefix.
set(CMAKE_INSTALL_RPATH "$ORIGIN;$ORIGIN/../${CMAKE_INSTALL_LIBDIR}")
# All programs in one folder, as in the build with ROS.
set(CMAKE_RUNTIME_OUTPUT_DIRECTORY ${CMAKE_BINARY_DIR}/bin)
if(BUILD_SHARED_LIBS)
  include(cmake/cmake_package.cmake)
endif()
