# The nodelet on a robot. The C++ tests load it into their own process.
foreach(name robot_loading robot_overload robot_reconfigure robot_sequence)
  add_executable(${name}_test ${name}_test.cpp)
  target_include_directories(${name}_test PRIVATE ${CMAKE_CURRENT_SOURCE_DIR})
  target_link_libraries(${name}_test ktgp_orb_nodelets ktgp_orb_warnings GTest::GTest
    Threads::Threads)
endforeach()
add_test(NAME robot_sequence COMMAND robot_sequence_test)
ktgp_orb_rostest(robot_loading robot_loading.test)
ktgp_orb_rostest(robot_overload robot_overload.test)
ktgp_orb_rostest(robot_reconfigure robot_reconfigure.test)
ktgp_orb_rostest(robot_reference robot_reference.test)
ktgp_orb_rostest(robot_time robot_time.test)
ktgp_orb_rostest(robot_diagnostics robot_diagnostics.test)
ktgp_orb_rostest(robot_paused_bag robot_paused_bag.test bag:=DATA/bags/tum_fr2desk_raw.bag)
ktgp_orb_rostest(robot_two_cameras robot_cameras.test "cameras:=left right")
ktgp_orb_rostest(robot_eight_cameras robot_cameras.test "cameras:=c1 c2 c3 c4 c5 c6 c7 c8")
ktgp_orb_rostest(robot_bag robot_bag.test data:=DATA/)
add_test(NAME robot_network
  COMMAND ${CMAKE_CURRENT_SOURCE_DIR}/run_in_devel ${CATKIN_DEVEL_PREFIX}
    /usr/bin/python3 ${CMAKE_CURRENT_SOURCE_DIR}/robot_network_test.py
    --gtest_output=xml:${PROJECT_BINARY_DIR}/test_results/robot_network/robot_network.xml)
set_tests_properties(robot_network PROPERTIES RUN_SERIAL ON TIMEOUT 300 SKIP_RETURN_CODE 77)
