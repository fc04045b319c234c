# SPDX-License-Identifier: BSD-3-Clause
# Optional libraries of the products of surveys: without them the program says which one it lacks.
# An installed package needs those that it was built with.

option(APVI_GDAL "Write GeoTIFF files with GDAL, if it is installed" ON)
option(APVI_OPEN3D "Make meshes with Open3D, if it is installed" ON)

# apvi_find_optional(<result> <wanted> <name>...): sets <result> and finds the library.
macro(apvi_find_optional result wanted)
  if(CMAKE_FIND_PACKAGE_NAME STREQUAL "apvi")
    if(${result})
      find_dependency(${ARGN})
    endif()
  else()
    set(${result} OFF)
    if(${wanted})
      find_package(${ARGN} QUIET)
      set(${result} ${${ARGV2}_FOUND})
    endif()
  endif()
endmacro()

if(APVI_LOCALIZATION)
  apvi_find_optional(APVI_WITH_GDAL APVI_GDAL GDAL 3.4)
  apvi_find_optional(APVI_WITH_OPEN3D APVI_OPEN3D Open3D CONFIG)
  if(APVI_WITH_OPEN3D)
    # GCC's default; as a definition it is in the way of headers that were precompiled without it.
    set_target_properties(Open3D::Open3D PROPERTIES INTERFACE_COMPILE_DEFINITIONS "")
  endif()
endif()
