# What is built upon the matcher's results: a room each for what draws (overlay), what measures against a truth
# (metrics), and the consumers mosaic, stabilization, motion and targets. No ROS header may be included there.
option(KTGP_ORB_EXTRAS "Build mosaic, stabilizer, ground motion and targets" ON)
add_library(ktgp_orb_views
  src/metrics/metrics.cpp
  src/metrics/repeatability.cpp
  src/overlay/canvas.cpp
  src/overlay/difference.cpp
  src/overlay/flow.cpp
  src/overlay/matches.cpp
  src/overlay/overlay.cpp
  src/overlay/panel.cpp
  src/overlay/text.cpp
)
if(KTGP_ORB_EXTRAS)
  target_sources(ktgp_orb_views PRIVATE
    src/mosaic/keyframes.cpp
    src/mosaic/mosaic.cpp
    src/mosaic/tile_map.cpp
    src/motion/base_report.cpp
    src/motion/camera_pose.cpp
    src/motion/ground_filter.cpp
    src/motion/ground_motion.cpp
    src/motion/relief.cpp
    src/motion/rows.cpp
    src/motion/twist_noise.cpp
    src/motion/validity.cpp
    src/targets/drawing.cpp
    src/stabilization/stabilizer.cpp
    src/targets/appearance.cpp
    src/targets/conflicts.cpp
    src/targets/frame_search.cpp
    src/targets/frame_tables.cpp
    src/targets/picture_aligner.cpp
    src/targets/picture_search.cpp
    src/targets/seeds.cpp
    src/targets/target_finder.cpp
    src/targets/target_index.cpp
    src/targets/target_picture.cpp
    src/targets/target_store.cpp
    src/targets/tracks.cpp
    src/targets/vote_dispatch.cpp
    src/targets/vote_kernel.cpp
  )
endif()
ktgp_orb_settings(ktgp_orb_views)
target_link_libraries(ktgp_orb_views PUBLIC ktgp_orb_core PRIVATE ktgp_orb_core_internals)
ktgp_orb_internals_of(ktgp_orb_views ktgp_orb_internals)
target_link_libraries(ktgp_orb_internals INTERFACE ktgp_orb_core_internals)
ktgp_orb_reuse_precompiled(ktgp_orb_core ktgp_orb_views)
# Compiled once for each instruction set; includes only what it needs.
set_source_files_properties(src/targets/vote_dispatch.cpp PROPERTIES SKIP_PRECOMPILE_HEADERS ON
  SKIP_UNITY_BUILD_INCLUSION ON)
# dev/check reads this file alone: another one of its library uses the same internal names.
set_source_files_properties(src/stabilization/stabilizer.cpp PROPERTIES SKIP_UNITY_BUILD_INCLUSION ON)

if(KTGP_ORB_EXTRAS)
  # The steadiest path over a whole recording, by linear programs. Part of ktgp_bag; not installed.
  add_library(ktgp_orb_steady_path STATIC src/stabilization/linear_program.cpp src/stabilization/steady_path.cpp)
  ktgp_orb_settings(ktgp_orb_steady_path)
  target_link_libraries(ktgp_orb_steady_path PUBLIC ktgp_orb_core PRIVATE ktgp_orb_core_internals)
  find_path(CLP_INCLUDE_DIR Clp_C_Interface.h PATH_SUFFIXES coin coin-or)
  find_library(CLP_LIBRARY Clp)
  if(CLP_INCLUDE_DIR AND CLP_LIBRARY)
    target_include_directories(ktgp_orb_steady_path SYSTEM PRIVATE ${CLP_INCLUDE_DIR})
    target_link_libraries(ktgp_orb_steady_path PRIVATE ${CLP_LIBRARY})
    target_compile_definitions(ktgp_orb_steady_path PRIVATE KTGP_ORB_HAVE_CLP=1)
  else()
    message(STATUS "Clp (coinor-libclp-dev) not found: ktgp_bag --stabilize needs --stabilizer_lag")
  endif()
  # With the flags and macros of the core, so that its precompiled headers serve all.
  set_target_properties(ktgp_orb_steady_path PROPERTIES POSITION_INDEPENDENT_CODE "${BUILD_SHARED_LIBS}")
  ktgp_orb_reuse_precompiled(ktgp_orb_core ktgp_orb_steady_path)
endif()

install(TARGETS ktgp_orb_views ${ktgp_orb_export}
  ARCHIVE DESTINATION ${CATKIN_PACKAGE_LIB_DESTINATION}
  LIBRARY DESTINATION ${CATKIN_PACKAGE_LIB_DESTINATION}
  RUNTIME DESTINATION ${CATKIN_GLOBAL_BIN_DESTINATION})
