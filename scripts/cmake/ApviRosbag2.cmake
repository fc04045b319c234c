# SPDX-License-Identifier: BSD-3-Clause
# Finds what ROS 2 bags are stored with: sqlite3, and the compressions of MCAP. Debian 12 has no
# CMake configs of them.

set(_apvi_rosbag2_missing "")
set(_apvi_rosbag2_includes "")
set(_apvi_rosbag2_libraries "")
foreach(library IN ITEMS lz4 zstd sqlite3)
  set(header ${library}.h)
  if(library STREQUAL "lz4")
    set(header lz4frame.h)
  endif()
  find_path(APVI_${library}_INCLUDE_DIR ${header})
  find_library(APVI_${library}_LIBRARY ${library})
  if(APVI_${library}_INCLUDE_DIR AND APVI_${library}_LIBRARY)
    list(APPEND _apvi_rosbag2_includes "${APVI_${library}_INCLUDE_DIR}")
    list(APPEND _apvi_rosbag2_libraries "${APVI_${library}_LIBRARY}")
  else()
    list(APPEND _apvi_rosbag2_missing "lib${library}-dev")
  endif()
  mark_as_advanced(APVI_${library}_INCLUDE_DIR APVI_${library}_LIBRARY)
endforeach()

if(_apvi_rosbag2_missing)
  list(JOIN _apvi_rosbag2_missing " " _apvi_rosbag2_missing)
  message(FATAL_ERROR "Reading ROS 2 bags needs: apt install ${_apvi_rosbag2_missing}")
endif()

if(NOT TARGET apvi_rosbag2_storage)
  list(REMOVE_DUPLICATES _apvi_rosbag2_includes)
  add_library(apvi_rosbag2_storage INTERFACE IMPORTED)
  set_target_properties(apvi_rosbag2_storage PROPERTIES
    INTERFACE_INCLUDE_DIRECTORIES "${_apvi_rosbag2_includes}"
    INTERFACE_LINK_LIBRARIES "${_apvi_rosbag2_libraries}")
endif()
