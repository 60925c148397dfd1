# What the libraries without ROS share.
if(BUILD_SHARED_LIBS)
  include(cmake/exports.cmake)
endif()

# ktgp_orb_settings(library): include folders, OpenCV and Eigen, flags. Shared libraries export what include/
# declares.
function(ktgp_orb_settings library)
  target_include_directories(${library} PRIVATE ${PROJECT_SOURCE_DIR}/src)
  # Users of our headers need these, too.
  #catkin_lint: ignore_once external_interface_path
  target_include_directories(${library} SYSTEM PUBLIC ${OpenCV_INCLUDE_DIRS} ${EIGEN3_INCLUDE_DIRS})
  target_link_libraries(${library}
    PUBLIC opencv_core opencv_imgproc opencv_features2d opencv_calib3d
    PRIVATE hwy::hwy ktgp_orb_warnings)
  # The same result on every machine: a*b + c is rounded twice, never fused.
  target_compile_options(${library} PRIVATE -ffp-contract=off)
  # Inline functions of the library (Eigen's templates, for example) must not be replaced by versions from a
  # program that was built with -march=native.
  target_compile_options(${library} PRIVATE -fvisibility-inlines-hidden)
endfunction()

# ktgp_orb_internals_of(library internals): a library with what include/ does not declare, from the same objects,
# for our own libraries, programs and tests.
function(ktgp_orb_internals_of library internals)
  if(NOT BUILD_SHARED_LIBS)
    add_library(${internals} INTERFACE)
    target_link_libraries(${internals} INTERFACE ${library})
    return()
  endif()
  ktgp_orb_export_public(${library})
  add_library(${internals} STATIC $<TARGET_OBJECTS:${library}>)
  set_target_properties(${internals} PROPERTIES LINKER_LANGUAGE CXX)
  add_dependencies(${internals} ${library})
  target_link_libraries(${internals} PRIVATE hwy::hwy Threads::Threads
    opencv_core opencv_imgproc opencv_features2d opencv_calib3d)
endfunction()
