# SPDX-License-Identifier: BSD-3-Clause
# Finds all third-party libraries on the system; nothing is vendored or downloaded. The installed
# package includes this file as well, so that consumers have the same dependencies as the build.

macro(apvi_find)
  if(CMAKE_FIND_PACKAGE_NAME STREQUAL "apvi")
    find_dependency(${ARGN})
  else()
    find_package(${ARGN} REQUIRED)
  endif()
endmacro()

apvi_find(Threads)
apvi_find(fmt)
apvi_find(spdlog)

if(APVI_LOCALIZATION)
  apvi_find(Eigen3 3.4 NO_MODULE)
  apvi_find(OpenCV 4 COMPONENTS core imgproc imgcodecs video videoio calib3d features2d)
  apvi_find(Ceres 2.1)
  apvi_find(yaml-cpp)
  apvi_find(nlohmann_json)
  apvi_find(tinyxml2)
  apvi_find(embree)  # ray casting in the simulator
  if(embree_VERSION VERSION_LESS 3.13)  # not above: Embree's own check rejects other major versions
    message(FATAL_ERROR "Embree 3.13 or 4 is required, found ${embree_VERSION}")
  endif()
  if(NOT TARGET yaml-cpp::yaml-cpp)  # Debian 12's 0.7 exports the bare name
    add_library(yaml-cpp::yaml-cpp ALIAS yaml-cpp)
  endif()
  if(NOT CMAKE_FIND_PACKAGE_NAME STREQUAL "apvi")
    find_package(CLI11 REQUIRED)  # only for the program
  endif()
  include(ApviRosbag2)
  if(APVI_WITH_ROSBAG)
    include(ApviRosbag)
  endif()
endif()

if(APVI_MAPPING)
  apvi_find(nlohmann_json)
  apvi_find(ZLIB)  # SPZ files
  include(ApviSurvey)
  include("${CMAKE_CURRENT_LIST_DIR}/ApviTorch.cmake")
endif()

if(APVI_BUILD_TESTS AND NOT CMAKE_FIND_PACKAGE_NAME STREQUAL "apvi")
  find_package(GTest REQUIRED)
  include(GoogleTest)
endif()
