# Highway and CLI11 for systems without them (Ubuntu 20.04, Debian 11): a pinned release is fetched when CMake
# configures. Offline, or for another release, name a source tree instead:
# -DFETCHCONTENT_SOURCE_DIR_HIGHWAY=/path and -DFETCHCONTENT_SOURCE_DIR_CLI11=/path. Without Highway CMake
# stops; without CLI11 the command-line programs are not built.
include(FetchContent)
option(KTGP_ORB_FETCH "Fetch Highway and CLI11 where they are not installed" ON)

# Sets NAME_SOURCE_DIR, or nothing if the release is not available. A file with a wrong checksum is never
# unpacked.
function(ktgp_orb_fetch name url sha256)
  string(TOUPPER ${name} upper)
  if(FETCHCONTENT_SOURCE_DIR_${upper})
    set(${name}_SOURCE_DIR ${FETCHCONTENT_SOURCE_DIR_${upper}} PARENT_SCOPE)
    return()
  endif()
  if(NOT KTGP_ORB_FETCH)
    return()
  endif()
  set(archive ${PROJECT_BINARY_DIR}/fetched/${name}.tar.gz)
  set(found "")
  if(EXISTS ${archive})
    file(SHA256 ${archive} found)
  endif()
  if(NOT found STREQUAL sha256)
    file(DOWNLOAD ${url} ${archive} STATUS status TIMEOUT 300 INACTIVITY_TIMEOUT 30 TLS_VERIFY ON)
    list(GET status 1 reason)
    file(SHA256 ${archive} found)
  endif()
  if(NOT found STREQUAL sha256)
    file(REMOVE ${archive})
    message(STATUS "${url} could not be fetched (${reason}, or not the expected file)")
    return()
  endif()
  FetchContent_Declare(${name} URL ${archive} URL_HASH SHA256=${sha256})
  if(POLICY CMP0169)
    cmake_policy(SET CMP0169 OLD)  # the newer way to unpack without configuring needs CMake 3.18
  endif()
  FetchContent_GetProperties(${name})
  if(NOT ${name}_POPULATED)
    FetchContent_Populate(${name})
  endif()
  set(${name}_SOURCE_DIR ${${name}_SOURCE_DIR} PARENT_SCOPE)
endfunction()

# A static library within ours; it is not installed.
function(ktgp_orb_add_highway)
  set(CMAKE_POLICY_DEFAULT_CMP0077 NEW)  # its options are the variables set here
  set(BUILD_SHARED_LIBS OFF)
  set(BUILD_TESTING OFF)
  set(HWY_ENABLE_CONTRIB OFF)
  set(HWY_ENABLE_EXAMPLES OFF)
  set(HWY_ENABLE_INSTALL OFF)
  set(HWY_ENABLE_TESTS OFF)
  set(CMAKE_POSITION_INDEPENDENT_CODE ON)
  add_subdirectory(${highway_SOURCE_DIR} ${PROJECT_BINARY_DIR}/fetched/highway EXCLUDE_FROM_ALL)
  if(NOT TARGET hwy::hwy)
    add_library(hwy::hwy ALIAS hwy)
  endif()
  # Highway 1.0 builds one target with an instruction set that GCC knows since version 11.
  file(STRINGS ${highway_SOURCE_DIR}/hwy/ops/set_macros-inl.h unknown_to_gcc_10 REGEX avxvnni)
  if(unknown_to_gcc_10 AND CMAKE_CXX_COMPILER_ID STREQUAL GNU AND
      CMAKE_CXX_COMPILER_VERSION VERSION_LESS 11)
    target_compile_definitions(hwy PUBLIC HWY_DISABLED_TARGETS=HWY_AVX3_DL)
  endif()
  # No warnings from its headers, as for an installed library.
  set_target_properties(hwy PROPERTIES INTERFACE_SYSTEM_INCLUDE_DIRECTORIES
    $<TARGET_PROPERTY:hwy,INTERFACE_INCLUDE_DIRECTORIES>)
endfunction()

if(NOT hwy_FOUND)
  # The same file as Debian's highway_1.2.0.orig.tar.gz.
  ktgp_orb_fetch(highway https://github.com/google/highway/archive/refs/tags/1.2.0.tar.gz
    7e0be78b8318e8bdbf6fa545d2ecb4c90f947df03f7aadc42c1967f019e63343)
  if(highway_SOURCE_DIR)
    ktgp_orb_add_highway()
  else()
    message(FATAL_ERROR "Highway (vector code) not found. Install the package libhwy-dev; where the system has "
      "none, allow CMake to fetch the source (-DKTGP_ORB_FETCH=ON) or name a source tree "
      "(-DFETCHCONTENT_SOURCE_DIR_HIGHWAY=/path/to/highway).")
  endif()
endif()

if(NOT CLI11_FOUND)
  # The checksum that Homebrew and others use for this release; Debian repacks it.
  ktgp_orb_fetch(cli11 https://github.com/CLIUtils/CLI11/archive/refs/tags/v2.4.2.tar.gz
    f2d893a65c3b1324c50d4e682c0cdc021dd0477ae2c048544f39eed6654b699a)
  if(cli11_SOURCE_DIR)
    # Only headers.
    add_library(CLI11::CLI11 INTERFACE IMPORTED)
    set_target_properties(CLI11::CLI11 PROPERTIES
      INTERFACE_INCLUDE_DIRECTORIES ${cli11_SOURCE_DIR}/include)
    set(CLI11_FOUND TRUE)
  endif()
endif()
