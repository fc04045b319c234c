# SPDX-License-Identifier: BSD-3-Clause
# Every third-party library, found on the system. Nothing is vendored and nothing is fetched.

find_package(Threads REQUIRED)
find_package(fmt REQUIRED)
find_package(spdlog REQUIRED)

if(APVI_LOCALIZATION)
  find_package(Eigen3 3.4 REQUIRED NO_MODULE)
  find_package(OpenCV 4 REQUIRED COMPONENTS core imgproc imgcodecs)
  find_package(yaml-cpp REQUIRED)
  find_package(nlohmann_json REQUIRED)
  find_package(CLI11 REQUIRED)
  if(NOT TARGET yaml-cpp::yaml-cpp)  # Debian 12's 0.7 exports the bare name
    add_library(yaml-cpp::yaml-cpp ALIAS yaml-cpp)
  endif()
  if(APVI_WITH_ROSBAG)
    include(ApviRosbag)
  endif()
endif()

if(APVI_BUILD_TESTS)
  find_package(GTest REQUIRED)
  include(GoogleTest)
endif()
