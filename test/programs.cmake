# The tests in C++: a program for each library, since linking takes longer than most of them. Their folders mirror
# src. Each file NAME_test.cpp is an entry of ctest, NAME_test, which runs the tests of this file:
#   ctest -R knn_matcher          core_tests --file=knn_matcher_test
# No ROS master is needed.

# ktgp_orb_test_program(program seconds [ROS] SOURCES ... LINK LIBRARIES ...): seconds as for ktgp_orb_build; ROS if
# its files include headers of ROS.
function(ktgp_orb_test_program program seconds)
  cmake_parse_arguments(test "ROS" "" "LINK" ${ARGN})
  add_executable(${program} support/main.cpp ${test_UNPARSED_ARGUMENTS})
  set_target_properties(${program} PROPERTIES RUNTIME_OUTPUT_DIRECTORY ${CMAKE_CURRENT_BINARY_DIR})
  if(TARGET tests)
    set_target_properties(${program} PROPERTIES EXCLUDE_FROM_ALL TRUE)
    add_dependencies(tests ${program})
  endif()
  target_include_directories(${program} PRIVATE ${PROJECT_SOURCE_DIR}/src ${PROJECT_SOURCE_DIR}/research)
  target_link_libraries(${program} ktgp_orb_test_support ktgp_orb_internals ktgp_orb_views hwy::hwy ktgp_orb_warnings
    opencv_imgcodecs ${KTGP_ORB_GTEST} Threads::Threads ${test_LINK})
  if(test_ROS)
    ktgp_orb_reuse_precompiled(ktgp_orb_ros_test_headers ${program})
  else()
    ktgp_orb_reuse_precompiled(ktgp_orb_test_headers ${program})
  endif()
  ktgp_orb_build(${program} ${seconds} ${program})
  foreach(file ${test_UNPARSED_ARGUMENTS})
    get_filename_component(name ${file} NAME_WE)
    if(NOT name MATCHES "_test$")
      continue()
    endif()
    if(KTGP_ORB_CORE_ONLY)
      add_test(NAME ${name} COMMAND ${program} --file=${name})
      ktgp_orb_waits(${name} build_${program})
    else()
      catkin_run_tests_target(gtest ${name} gtest-${name}.xml DEPENDENCIES ${program} COMMAND
        "${CMAKE_CURRENT_BINARY_DIR}/${program} --file=${name} --gtest_output=xml:${CATKIN_TEST_RESULTS_DIR}/${PROJECT_NAME}/gtest-${name}.xml")
      ktgp_orb_waits(_ctest_${PROJECT_NAME}_gtest_${name} build_${program})
    endif()
  endforeach()
endfunction()

# ktgp_orb_tests_below(variable FOLDERS ...): their files of tests.
function(ktgp_orb_tests_below variable)
  list(TRANSFORM ARGN REPLACE "(.+)" "${CMAKE_CURRENT_SOURCE_DIR}/\\1/*_test.cpp")
  file(GLOB_RECURSE files CONFIGURE_DEPENDS ${ARGN})
  set(${variable} ${files} PARENT_SCOPE)
endfunction()

set(research ${PROJECT_SOURCE_DIR}/research)

ktgp_orb_tests_below(files util estimation homography features matching growth two_view pose sequence)
# Alone: dev/sanitize builds it.
list(FILTER files EXCLUDE REGEX "frame_reuse_test")
ktgp_orb_test_program(core_tests 1800 ${files} support/allocation_counter.cpp
  ${research}/evaluation/rendering.cpp)
ktgp_orb_test_program(frame_reuse_test 600 sequence/frame_reuse_test.cpp)

ktgp_orb_tests_below(files metrics overlay mosaic motion stabilization targets)
ktgp_orb_test_program(views_tests 1700 ${files} library/acceptance_test.cpp library/options_test.cpp
  library/slow_camera_test.cpp support/allocation_counter.cpp
  ${research}/evaluation/rendering.cpp LINK ktgp_orb_steady_path)

# Alone: they replace malloc or operator new, or have compiler options of their own.
ktgp_orb_test_program(heap_test 600 library/heap_test.cpp)
ktgp_orb_test_program(out_of_memory_test 600 library/out_of_memory_test.cpp support/allocation_counter.cpp)
# The list of all public types is made of the headers.
set(includes "")
set(types "")
file(GLOB headers CONFIGURE_DEPENDS ${PROJECT_SOURCE_DIR}/include/ktgp_orb/*.h)
foreach(header ${headers})
  get_filename_component(name ${header} NAME)
  string(APPEND includes "#include \"ktgp_orb/${name}\"\n")
  file(STRINGS ${header} lines REGEX "^(namespace|struct|class) .*{$")
  foreach(line ${lines})
    if(line MATCHES "^namespace ([a-z_:]+)")
      set(space ${CMAKE_MATCH_1})
    elseif(line MATCHES "^(struct|class) ([A-Za-z0-9]+) ")
      string(APPEND types "    KTGP_ORB_TYPE(${space}::${CMAKE_MATCH_2}),\n")
    endif()
  endforeach()
endforeach()
configure_file(library/result_layout.h.in ${CMAKE_CURRENT_BINARY_DIR}/result_layout.h @ONLY)
ktgp_orb_test_program(result_layout_test 600 library/result_layout_test.cpp library/result_layout_wide.cpp)
target_include_directories(result_layout_test PRIVATE ${CMAKE_CURRENT_BINARY_DIR})
ktgp_orb_test_program(user_flags_test 600 library/user_flags_test.cpp library/user_flags_fused.cpp)
if(CMAKE_SYSTEM_PROCESSOR MATCHES "x86_64|AMD64")
  set_source_files_properties(library/result_layout_wide.cpp PROPERTIES COMPILE_OPTIONS "-mavx512f;-mfma"
    SKIP_PRECOMPILE_HEADERS ON)
  set_source_files_properties(library/user_flags_fused.cpp PROPERTIES COMPILE_OPTIONS
    "-mfma;-ffp-contract=fast" SKIP_PRECOMPILE_HEADERS ON)
endif()

ktgp_orb_tests_below(files parameters)
set(libraries ktgp_orb_parameters)
if(TARGET ktgp_orb_cli)
  ktgp_orb_tests_below(files parameters files tools)
  list(APPEND libraries ktgp_orb_cli)
endif()
ktgp_orb_test_program(tools_tests 600 ${files} LINK ${libraries})

if(TARGET ktgp_orb_messages)
  ktgp_orb_tests_below(files bag nodelet ros)
  list(FILTER files EXCLUDE REGEX "/robot_")  # they load nodelets: see robot_tests.cmake
  ktgp_orb_test_program(ros_tests 1600 ROS ${files} LINK ktgp_orb_messages ktgp_orb_bag)
  # The test reads the names of all encodings from the header.
  find_path(sensor_msgs_headers sensor_msgs/image_encodings.h HINTS ${sensor_msgs_INCLUDE_DIRS}
    NO_CMAKE_FIND_ROOT_PATH)
  target_compile_definitions(ros_tests PRIVATE
    KTGP_ORB_ENCODINGS_HEADER="${sensor_msgs_headers}/sensor_msgs/image_encodings.h")
endif()

if(TARGET ktgp_orb_evaluation)
  ktgp_orb_tests_below(files research)
  set(demo ${research}/demo)
  ktgp_orb_test_program(research_tests 500 ${files} ${research}/evaluation/target_frames.cpp ${demo}/canvas.cpp
    ${demo}/effects.cpp ${demo}/flight.cpp ${demo}/landscape.cpp ${demo}/map.cpp
    LINK ktgp_orb_evaluation opencv_video opencv_videoio stdc++fs)
endif()
if(TARGET research_tests)
  set_tests_properties(build_research_tests PROPERTIES LABELS full)
  ktgp_orb_full(gtest_demo_truth_test gtest_evaluate_test gtest_target_frames_test gtest_warps_test)
endif()
ktgp_orb_full(gtest_hostile_bag_test)

ktgp_orb_starts_early(130 gtest_slow_camera_test gtest_target_frames_test)
ktgp_orb_starts_early(90 gtest_target_finder_test)
ktgp_orb_starts_early(50 gtest_acceptance_test gtest_alignment_test gtest_knn_matcher_test gtest_mounting_test
  gtest_warps_test)
