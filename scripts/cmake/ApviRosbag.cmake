# SPDX-License-Identifier: BSD-3-Clause
# Finds rosbag_storage, which reads and writes ROS 1 bags without ROS. The CMake config of Debian's
# package requires catkin, and pluginlib uses the folder layout of ROS 2, hence the manual search.

find_path(APVI_ROSBAG_INCLUDE_DIR rosbag/bag.h)
find_library(APVI_ROSBAG_LIBRARY rosbag_storage)
set(_apvi_rosbag_missing "")
if(NOT APVI_ROSBAG_INCLUDE_DIR OR NOT APVI_ROSBAG_LIBRARY)
  list(APPEND _apvi_rosbag_missing "librosbag-storage-dev")
endif()
set(_apvi_rosbag_includes "${APVI_ROSBAG_INCLUDE_DIR}")
foreach(package IN ITEMS pluginlib class_loader rcutils rcpputils ament_index_cpp)
  find_path(APVI_${package}_INCLUDE_DIR ${package} PATH_SUFFIXES ${package})
  if(APVI_${package}_INCLUDE_DIR)
    list(APPEND _apvi_rosbag_includes "${APVI_${package}_INCLUDE_DIR}")
  else()
    list(APPEND _apvi_rosbag_missing "pluginlib-dev")
  endif()
  mark_as_advanced(APVI_${package}_INCLUDE_DIR)
endforeach()
set(_apvi_rosbag_libraries "${APVI_ROSBAG_LIBRARY}")
foreach(library IN ITEMS roscpp_serialization rostime cpp_common console_bridge class_loader)
  find_library(APVI_${library}_LIBRARY ${library})
  if(APVI_${library}_LIBRARY)
    list(APPEND _apvi_rosbag_libraries "${APVI_${library}_LIBRARY}")
  endif()
  mark_as_advanced(APVI_${library}_LIBRARY)
endforeach()

if(_apvi_rosbag_missing)
  list(REMOVE_DUPLICATES _apvi_rosbag_missing)
  list(JOIN _apvi_rosbag_missing " " _apvi_rosbag_missing)
  message(FATAL_ERROR "Reading ROS1 bags needs: apt install ${_apvi_rosbag_missing}\n"
                      "or configure with -DAPVI_WITH_ROSBAG=OFF")
endif()

if(NOT TARGET apvi_rosbag_storage)
  add_library(apvi_rosbag_storage INTERFACE IMPORTED)
  set_target_properties(apvi_rosbag_storage PROPERTIES
    INTERFACE_INCLUDE_DIRECTORIES "${_apvi_rosbag_includes}"
    INTERFACE_LINK_LIBRARIES "${_apvi_rosbag_libraries}")
endif()
