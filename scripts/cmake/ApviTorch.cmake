# SPDX-License-Identifier: BSD-3-Clause
# Defines the target apvi_torch for LibTorch from Debian (CPU) or the Python package torch (CPU or CUDA).
# third_party/README.md explains how to select the latter.

if(TARGET apvi_torch)
  return()
endif()

# find_package(Torch) for this project: with TorchConfig's changes of the CUDA architectures undone.
# TorchConfig replaces CMAKE_CUDA_ARCHITECTURES, appends its own -gencode flags, and tries to detect
# GPUs if no architecture list is set. Set the list, and restore the variables afterwards.
macro(apvi_find_torch)
  set(apvi_cuda_architectures "${CMAKE_CUDA_ARCHITECTURES}")
  set(apvi_cuda_flags "${CMAKE_CUDA_FLAGS}")
  if(NOT DEFINED ENV{TORCH_CUDA_ARCH_LIST} AND NOT TORCH_CUDA_ARCH_LIST)
    set(apvi_arch_list "9.0")
    if(apvi_cuda_architectures MATCHES "^[0-9]")
      list(TRANSFORM apvi_cuda_architectures REPLACE "^([0-9]+)([0-9][af]?)(-real|-virtual)?$" "\\1.\\2"
           OUTPUT_VARIABLE apvi_arch_list)
    endif()
    list(JOIN apvi_arch_list " " TORCH_CUDA_ARCH_LIST)
  endif()
  # Older TorchConfigs require a library that was removed in CUDA 12.9.
  if(APVI_BACKEND STREQUAL "cuda" AND NOT TARGET CUDA::nvToolsExt)
    add_library(CUDA::nvToolsExt INTERFACE IMPORTED)
  endif()
  if(APVI_TORCH_DIR)
    find_package(Torch REQUIRED PATHS "${APVI_TORCH_DIR}" NO_DEFAULT_PATH)
  else()
    find_package(Torch REQUIRED)
  endif()
  set(CMAKE_CUDA_FLAGS "${apvi_cuda_flags}")
  set(CMAKE_CUDA_ARCHITECTURES "${apvi_cuda_architectures}")
endmacro()

# A Python package with CUDA, for a build without: TorchConfig would demand the CUDA toolkit, so that
# the CPU libraries of the package are named here.
macro(apvi_use_cpu_part_of_torch prefix)
  set(TORCH_INSTALL_PREFIX "${prefix}")
  set(TORCH_LIBRARY "${prefix}/lib/libtorch_cpu.so")
  set(c10_LIBRARY "${prefix}/lib/libc10.so")
  set(Torch_DIR "${prefix}/share/cmake/Torch")
  include("${Torch_DIR}/TorchConfigVersion.cmake")
  set(Torch_VERSION "${PACKAGE_VERSION}")
  add_library(apvi_torch_cpu SHARED IMPORTED GLOBAL)
  set_target_properties(apvi_torch_cpu PROPERTIES
    IMPORTED_LOCATION "${TORCH_LIBRARY}" INTERFACE_LINK_LIBRARIES "${c10_LIBRARY}"
    INTERFACE_INCLUDE_DIRECTORIES "${prefix}/include;${prefix}/include/torch/csrc/api/include")
  set(TORCH_LIBRARIES apvi_torch_cpu)
endmacro()

set(apvi_torch_package "")
foreach(folder IN LISTS APVI_TORCH_DIR CMAKE_PREFIX_PATH ITEMS "$ENV{CMAKE_PREFIX_PATH}")
  string(REGEX REPLACE "/share/cmake/Torch/?$" "" folder "${folder}")
  if(NOT apvi_torch_package AND EXISTS "${folder}/lib/libtorch_cuda.so")
    set(apvi_torch_package "${folder}")
  endif()
endforeach()
if(apvi_torch_package AND APVI_BACKEND STREQUAL "cpu")
  apvi_use_cpu_part_of_torch("${apvi_torch_package}")
else()
  apvi_find_torch()
endif()

# With two LibTorch installations, CMake may mix the headers of one with the libraries of the other.
cmake_path(SET apvi_torch_prefix NORMALIZE "${TORCH_INSTALL_PREFIX}/")
foreach(library IN ITEMS "${TORCH_LIBRARY}" "${c10_LIBRARY}")
  if(library AND NOT library MATCHES "^${apvi_torch_prefix}")
    message(FATAL_ERROR "LibTorch's headers are below ${apvi_torch_prefix} but ${library} was found: "
      "delete the build folder, and set CMAKE_PREFIX_PATH to the torch folder itself "
      "(python3 -c 'import torch, pathlib; print(pathlib.Path(torch.__file__).parent)').")
  endif()
endforeach()
if(APVI_BACKEND STREQUAL "cuda" AND NOT TARGET torch_cuda)
  message(FATAL_ERROR "APVI_BACKEND is cuda, but the LibTorch in ${apvi_torch_prefix} has no CUDA: "
    "set CMAKE_PREFIX_PATH to the folder of a torch package with CUDA (third_party/README.md).")
endif()

add_library(apvi_torch INTERFACE IMPORTED GLOBAL)
# LibTorch 2 ships headers of a newer fmt than Debian's library, so fmt must be used header-only.
target_link_libraries(apvi_torch INTERFACE ${TORCH_LIBRARIES} fmt::fmt-header-only)
# at::parallel_for is a header-only template that runs on one thread without OpenMP.
apvi_find(OpenMP COMPONENTS CXX)
target_link_libraries(apvi_torch INTERFACE OpenMP::OpenMP_CXX)
if(TARGET torch_cuda OR TARGET apvi_torch_cpu)
  # The wheels store the CUDA libraries in separate folders that must be in the run path; as RPATH
  # rather than RUNPATH, because they are mostly dependencies of LibTorch's libraries.
  target_link_options(apvi_torch INTERFACE -Wl,--allow-shlib-undefined -Wl,--disable-new-dtags)
  # The wheels' libtorch exports parts of its own libstdc++ (std::filesystem) that are incompatible:
  # link the system libstdc++ first.
  target_link_options(apvi_torch INTERFACE
    -Wl,--push-state,--no-as-needed -lstdc++ -Wl,--pop-state)
  file(GLOB apvi_wheel_libraries LIST_DIRECTORIES TRUE "${apvi_torch_prefix}../nvidia/*/lib")
  foreach(folder IN LISTS apvi_wheel_libraries)
    cmake_path(NORMAL_PATH folder)
    target_link_options(apvi_torch INTERFACE "-Wl,-rpath,${folder}")
  endforeach()
endif()
