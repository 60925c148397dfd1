# Included by both CMake packages, that of catkin and that without ROS: find_package(ktgp_orb COMPONENTS core views)
# means the same in a workspace, in an install space and for the library alone.
if(ktgp_orb_FOUND_CATKIN_PROJECT)
  # catkin exports files, no targets.
  find_package(OpenCV QUIET REQUIRED COMPONENTS core imgproc features2d calib3d)
  foreach(component core views)
    set(file ${ktgp_orb_LIBRARIES})
    list(FILTER file INCLUDE REGEX "/libktgp_orb_${component}\\.(so|a)$")
    if(file AND NOT TARGET ktgp_orb_${component})
      add_library(ktgp_orb_${component} UNKNOWN IMPORTED)
      set_target_properties(ktgp_orb_${component} PROPERTIES
        IMPORTED_LOCATION "${file}"
        INTERFACE_INCLUDE_DIRECTORIES "${ktgp_orb_INCLUDE_DIRS}"
        INTERFACE_LINK_LIBRARIES "opencv_core;opencv_imgproc;opencv_features2d;opencv_calib3d")
    endif()
  endforeach()
  if(TARGET ktgp_orb_views)
    set_property(TARGET ktgp_orb_views APPEND PROPERTY INTERFACE_LINK_LIBRARIES ktgp_orb_core)
  endif()
endif()
foreach(component ${ktgp_orb_FIND_COMPONENTS})
  if(TARGET ktgp_orb_${component})
    set(ktgp_orb_${component}_FOUND TRUE)
  elseif(ktgp_orb_FIND_REQUIRED_${component})
    set(ktgp_orb_FOUND FALSE)
    set(ktgp_orb_NOT_FOUND_MESSAGE "ktgp_orb has no component ${component}; its components are core and views")
  endif()
endforeach()
