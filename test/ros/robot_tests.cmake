# The nodelet on a robot. The C++ tests load it into their own process.
function(ktgp_orb_robot_test name)
  add_executable(${name}_test ${name}_test.cpp)
  target_include_directories(${name}_test PRIVATE ${CMAKE_CURRENT_SOURCE_DIR})
  target_link_libraries(${name}_test ktgp_orb_nodelets ktgp_orb_warnings GTest::GTest
    Threads::Threads)
  ktgp_orb_rostest(${name} ${name}.test)
endfunction()
ktgp_orb_robot_test(robot_loading)
ktgp_orb_robot_test(robot_overload)
ktgp_orb_robot_test(robot_reconfigure)
