# Installs the libraries for programs without ROS: headers, a CMake package (find_package(ktgp_orb COMPONENTS core
# views): targets ktgp_orb_core and ktgp_orb_views) and files for pkg-config. The folder's name differs from that
# of catkin's package, which may be installed beside it.
include(CMakePackageConfigHelpers)
include(GNUInstallDirs)
set(ktgp_orb_export EXPORT ktgp_orb_targets)
#catkin_lint: ignore wrong_install_destination
set(ktgp_orb_config ${CMAKE_INSTALL_LIBDIR}/cmake/${PROJECT_NAME}-1)
install(EXPORT ktgp_orb_targets DESTINATION ${ktgp_orb_config})
write_basic_package_version_file(${PROJECT_BINARY_DIR}/ktgp_orbConfigVersion.cmake
  COMPATIBILITY SameMinorVersion)
configure_file(cmake/ktgp_orbConfig.cmake.in ktgp_orbConfig.cmake @ONLY)
install(FILES ${PROJECT_BINARY_DIR}/ktgp_orbConfig.cmake ${PROJECT_BINARY_DIR}/ktgp_orbConfigVersion.cmake
    cmake/ktgp_orb-extras.cmake
  DESTINATION ${ktgp_orb_config})
foreach(component core views)
  configure_file(cmake/ktgp_orb_${component}.pc.in ktgp_orb_${component}.pc @ONLY)
  install(FILES ${PROJECT_BINARY_DIR}/ktgp_orb_${component}.pc DESTINATION ${CMAKE_INSTALL_LIBDIR}/pkgconfig)
endforeach()
