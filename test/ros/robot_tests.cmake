# The nodelet on a robot. The C++ tests load it into their own process.
add_library(robot_main STATIC EXCLUDE_FROM_ALL robot_main.cpp)
target_include_directories(robot_main PUBLIC ${CMAKE_CURRENT_SOURCE_DIR})
target_link_libraries(robot_main PUBLIC
  ktgp_orb_test_support ktgp_orb_nodelets ktgp_orb_warnings ${KTGP_ORB_GTEST} Threads::Threads)
ktgp_orb_reuse_precompiled(ktgp_orb_ros_test_headers robot_main)
foreach(name robot_heap robot_loading robot_overload robot_reconfigure robot_stream robot_teardown
    robot_views_teardown)
  add_executable(${name}_test EXCLUDE_FROM_ALL ${name}_test.cpp)
  target_link_libraries(${name}_test robot_main)
  ktgp_orb_reuse_precompiled(ktgp_orb_ros_test_headers ${name}_test)
  add_dependencies(tests ${name}_test)
  ktgp_orb_rostest(${name} program.test name:=${name})
  ktgp_orb_waits(_ctest_${PROJECT_NAME}_rostest_${name} build_robot_tests)
  list(APPEND robot_tests ${name}_test)
endforeach()
ktgp_orb_build(robot_tests 1900 ${robot_tests})
# Like heap_test it replaces malloc, and it needs function names for addresses.
target_link_libraries(robot_heap_test ${CMAKE_DL_LIBS})
foreach(name robot_diagnostics robot_reference)
  ktgp_orb_stream_test(${name} ${name})
endforeach()
foreach(name robot_clock robot_consumers robot_motion robot_pose robot_targets)
  ktgp_orb_rostest(${name} ${name}.test)
endforeach()
ktgp_orb_stream_test(robot_inputs robot_inputs queue_size:=5 limit:=1500)
ktgp_orb_rostest(robot_targets_files program.test name:=robot_targets_files type:=run_test.py
  args:=robot_targets_files_test)
ktgp_orb_rostest(robot_paused_bag robot_paused_bag.test bag:=DATA/bags/tum_fr2desk_raw.bag)
ktgp_orb_rostest(robot_two_cameras robot_cameras.test name:=robot_two_cameras
  "cameras:=left right")
ktgp_orb_rostest(robot_eight_cameras robot_cameras.test name:=robot_eight_cameras
  "cameras:=c1 c2 c3 c4 c5 c6 c7 c8")
if(TARGET ktgp_bag)
  ktgp_orb_rostest(robot_bag robot_bag.test data:=DATA/)
endif()
ktgp_orb_python_test(robot_network ${CMAKE_CURRENT_SOURCE_DIR}/robot_network_test.py)
