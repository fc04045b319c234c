# SPDX-License-Identifier: BSD-3-Clause
# Enables the CUDA language and sets the compile options of the kernels.

find_package(CUDAToolkit REQUIRED)

# The only list of GPUs: those of this machine for a program that runs here, else what people own.
if(NOT CMAKE_CUDA_ARCHITECTURES)
  set(apvi_architectures 75 80 86 89 90 120)
  if(CUDAToolkit_VERSION VERSION_LESS 12.8)
    list(REMOVE_ITEM apvi_architectures 120)
  endif()
  if(APVI_BACKEND STREQUAL "cuda" AND EXISTS /dev/nvidia0)
    set(apvi_architectures native)
  endif()
  set(CMAKE_CUDA_ARCHITECTURES ${apvi_architectures} CACHE STRING "GPU architectures to compile for")
endif()
enable_language(CUDA)
if(NOT DEFINED CMAKE_CUDA20_STANDARD_COMPILE_OPTION)  # missing in CMake 3.25
  set(CMAKE_CUDA20_STANDARD_COMPILE_OPTION "-std=c++20")
  set(CMAKE_CUDA20_EXTENSION_COMPILE_OPTION "-std=c++20")
endif()
set(CMAKE_CUDA_STANDARD 20)
set(CMAKE_CUDA_STANDARD_REQUIRED ON)

add_library(apvi_kernels_options INTERFACE)
target_compile_options(apvi_kernels_options INTERFACE
  $<$<COMPILE_LANGUAGE:CUDA>:-Xcompiler=-Wall,-Wextra,-Wshadow -Xcudafe=--display_error_number>
  $<$<AND:$<COMPILE_LANGUAGE:CUDA>,$<BOOL:${APVI_WERROR}>>:-Werror=all-warnings>)
