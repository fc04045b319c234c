# SPDX-License-Identifier: BSD-3-Clause
# Depth of keyframes, its backend on the CPU, and what the module has on a GPU.
set(fallback ${PROJECT_SOURCE_DIR}/cpu_fallback/mapping)
target_sources(apvi_mapping PRIVATE
  depth.cpp depth_backend.cpp depth_confidence.cpp depth_geometry.cpp quadtree.cpp
  ${fallback}/backend.cpp ${fallback}/belief_propagation.cpp ${fallback}/depth_sweep.cpp
  ${fallback}/smooth.cpp ${fallback}/surfaces.cpp ${fallback}/sweep_patch.cpp)
# Sums over a patch may be taken in any order; nothing there reads errno or floating-point traps.
set_source_files_properties(${fallback}/sweep_patch.cpp PROPERTIES
  COMPILE_OPTIONS "-fno-math-errno;-fno-trapping-math;-fassociative-math;-fno-signed-zeros"
  SKIP_PRECOMPILE_HEADERS ON)
target_compile_definitions(apvi_mapping PRIVATE APVI_WITH_CUDA=$<STREQUAL:${APVI_BACKEND},cuda>)
if(APVI_BACKEND STREQUAL "cuda")
  target_sources(apvi_mapping PRIVATE
    ${PROJECT_SOURCE_DIR}/kernels/mapping/cuda_depth.cpp
    ${PROJECT_SOURCE_DIR}/kernels/mapping/cuda_step.cpp $<TARGET_OBJECTS:apvi_mapping_kernels>)
endif()
