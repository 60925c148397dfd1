# The library and its tools without ROS; GNU's folders replace those of catkin.
include(GNUInstallDirs)
#catkin_lint: ignore immutable_var
#catkin_lint: ignore wrong_install_destination
set(CATKIN_PACKAGE_LIB_DESTINATION ${CMAKE_INSTALL_LIBDIR})
set(CATKIN_GLOBAL_BIN_DESTINATION ${CMAKE_INSTALL_BINDIR})
set(CATKIN_PACKAGE_BIN_DESTINATION ${CMAKE_INSTALL_BINDIR})
option(BUILD_SHARED_LIBS "Build shared libraries, which are installed as a CMake package" ON)
option(CATKIN_ENABLE_TESTING "Build the tests" ON)
enable_testing()
install(DIRECTORY include/${PROJECT_NAME}/ DESTINATION ${CMAKE_INSTALL_INCLUDEDIR}/${PROJECT_NAME})
# All programs in one folder, as in the build with ROS.
set(CMAKE_RUNTIME_OUTPUT_DIRECTORY ${CMAKE_BINARY_DIR}/bin)
# find_package(ktgp_orb COMPONENTS core views): targets ktgp_orb_core and ktgp_orb_views.
if(BUILD_SHARED_LIBS)
  #catkin_lint: skip
  include(CMakePackageConfigHelpers)
  set(ktgp_orb_export EXPORT ktgp_orb_targets)
  set(ktgp_orb_config ${CMAKE_INSTALL_LIBDIR}/cmake/${PROJECT_NAME})
  install(EXPORT ktgp_orb_targets DESTINATION ${ktgp_orb_config})
  write_basic_package_version_file(${PROJECT_BINARY_DIR}/ktgp_orbConfigVersion.cmake
    COMPATIBILITY SameMinorVersion)
  configure_file(cmake/ktgp_orbConfig.cmake.in ktgp_orbConfig.cmake @ONLY)
  install(FILES ${PROJECT_BINARY_DIR}/ktgp_orbConfig.cmake ${PROJECT_BINARY_DIR}/ktgp_orbConfigVersion.cmake
    DESTINATION ${ktgp_orb_config})
endif()
