# SPDX-License-Identifier: BSD-3-Clause
apvi_add_torch_test(depth
  SOURCES belief_propagation_test.cpp depth_sweep_test.cpp depth_test.cpp quadtree_test.cpp
          surfaces_test.cpp
  DEPENDS apvi::mapping)
if(APVI_BACKEND STREQUAL "cuda")
  apvi_add_torch_test(depth_cuda SOURCES cuda_depth_test.cpp cuda_memory_test.cpp step_backend_test.cpp DEPENDS apvi::mapping LABELS cuda)
  target_include_directories(apvi_depth_cuda_test PRIVATE ${PROJECT_SOURCE_DIR}/src)
endif()
