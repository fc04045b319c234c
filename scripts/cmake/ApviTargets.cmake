# SPDX-License-Identifier: BSD-3-Clause
# Global compile options, and functions that define modules and tests.

include(GNUInstallDirs)
set(CMAKE_CXX_STANDARD 20)
set(CMAKE_CXX_STANDARD_REQUIRED ON)
set(CMAKE_CXX_EXTENSIONS OFF)
set(CMAKE_POSITION_INDEPENDENT_CODE ON)
set(CMAKE_EXPORT_COMPILE_COMMANDS ON)
set_property(GLOBAL PROPERTY GLOBAL_DEPENDS_NO_CYCLES ON)

if(NOT CMAKE_BUILD_TYPE AND NOT CMAKE_CONFIGURATION_TYPES)
  set(CMAKE_BUILD_TYPE Release CACHE STRING "Build type" FORCE)
endif()

find_program(APVI_CCACHE ccache)
if(APVI_CCACHE AND NOT CMAKE_CXX_COMPILER_LAUNCHER)
  # Without CCACHE_SLOPPINESS, ccache rejects all files that use a precompiled header; the other two settings let
  # several clones share the cache.
  set(CMAKE_CXX_COMPILER_LAUNCHER ${CMAKE_COMMAND} -E env CCACHE_SLOPPINESS=pch_defines,time_macros
      CCACHE_NOHASHDIR=1 CCACHE_BASEDIR=${PROJECT_SOURCE_DIR} "${APVI_CCACHE}")
  set(CMAKE_CUDA_COMPILER_LAUNCHER "${APVI_CCACHE}")
endif()

# Compile options of this project; not exported to consumers.
add_library(apvi_options INTERFACE)
target_include_directories(apvi_options INTERFACE ${PROJECT_SOURCE_DIR}/src ${PROJECT_SOURCE_DIR})
target_compile_options(apvi_options INTERFACE
  $<$<COMPILE_LANGUAGE:CXX>:-Wall -Wextra -Wpedantic -Wconversion -Wshadow>
  $<$<AND:$<COMPILE_LANGUAGE:CXX>,$<BOOL:${APVI_WERROR}>>:-Werror>)
if(CMAKE_CXX_COMPILER_ID STREQUAL "GNU" AND CMAKE_CXX_COMPILER_VERSION VERSION_LESS 13)
  target_compile_options(apvi_options INTERFACE  # false alarm in "a" + std::string, GCC bug 105651
    $<$<COMPILE_LANGUAGE:CXX>:-Wno-restrict>)
endif()
if(CMAKE_SYSTEM_PROCESSOR MATCHES "x86_64|AMD64")
  target_compile_options(apvi_options INTERFACE $<$<COMPILE_LANGUAGE:CXX>:-march=x86-64-v2>)
endif()
if(APVI_SANITIZE)
  add_compile_options($<$<COMPILE_LANGUAGE:CXX>:-fsanitize=${APVI_SANITIZE}>
                      $<$<COMPILE_LANGUAGE:CXX>:-fno-sanitize-recover=all>
                      $<$<COMPILE_LANGUAGE:CXX>:-fno-omit-frame-pointer>)
  add_link_options(-fsanitize=${APVI_SANITIZE})
endif()

# apvi_add_module(<name> SOURCES a.cpp ... [DEPENDS apvi::core Eigen3::Eigen ...] [PRIVATE_DEPENDS ...])
# defines the static library apvi_<name>, alias apvi::<name>, installed and exported.
function(apvi_add_module name)
  cmake_parse_arguments(ARG "" "" "SOURCES;DEPENDS;PRIVATE_DEPENDS" ${ARGN})
  add_library(apvi_${name} STATIC ${ARG_SOURCES})
  add_library(apvi::${name} ALIAS apvi_${name})
  set_target_properties(apvi_${name} PROPERTIES EXPORT_NAME ${name})
  target_compile_features(apvi_${name} PUBLIC cxx_std_20)
  target_include_directories(apvi_${name} PUBLIC
    $<BUILD_INTERFACE:${PROJECT_SOURCE_DIR}/include> $<INSTALL_INTERFACE:${CMAKE_INSTALL_INCLUDEDIR}>)
  target_link_libraries(apvi_${name} PUBLIC ${ARG_DEPENDS}
    PRIVATE $<BUILD_INTERFACE:apvi_options> ${ARG_PRIVATE_DEPENDS})
  install(TARGETS apvi_${name} EXPORT apviTargets
          ARCHIVE DESTINATION ${CMAKE_INSTALL_LIBDIR} COMPONENT development)
endfunction()

# apvi_precompile_torch(<target>): precompiles torch/torch.h, which takes 13 s to parse. All targets share
# one precompiled header of 630 MB; this requires -fPIC for programs, too.
function(apvi_precompile_torch target)
  if(NOT TARGET apvi_torch_header)
    add_library(apvi_torch_header OBJECT ${PROJECT_SOURCE_DIR}/scripts/cmake/torch_header.cpp)
    target_link_libraries(apvi_torch_header PRIVATE apvi_options apvi_torch)
    target_precompile_headers(apvi_torch_header PRIVATE <torch/torch.h>)
    target_compile_options(apvi_torch_header PRIVATE
      $<$<COMPILE_LANG_AND_ID:CXX,GNU>:-fpch-preprocess>)  # for ccache
  endif()
  target_precompile_headers(${target} REUSE_FROM apvi_torch_header)
  target_compile_options(${target} PRIVATE -fPIC $<$<COMPILE_LANG_AND_ID:CXX,GNU>:-fpch-preprocess>)
endfunction()

# Labels of tests: quick (the whole set takes a minute on two cores), slow, cuda (needs a GPU).

# Ends a test that hangs [s]. It is no limit of speed: a machine with other work may be many times slower.
set(APVI_TEST_TIMEOUT 1800)

function(apvi_make_test_program name sources depends)
  add_executable(apvi_${name}_test ${sources})
  target_link_libraries(apvi_${name}_test PRIVATE apvi_options apvi_test_support ${depends} GTest::gmock GTest::gtest_main)
endfunction()

# apvi_add_test(<module> SOURCES a_test.cpp ... [DEPENDS ...] [LABELS quick|slow])
# defines one test program for the module; every TEST is a separate CTest case.
function(apvi_add_test name)
  cmake_parse_arguments(ARG "" "LABELS" "SOURCES;DEPENDS" ${ARGN})
  if(NOT ARG_LABELS)
    set(ARG_LABELS quick)
  endif()
  apvi_make_test_program(${name} "${ARG_SOURCES}" "${ARG_DEPENDS}")
  gtest_discover_tests(apvi_${name}_test TEST_PREFIX "${name}/" DISCOVERY_TIMEOUT 300
                       PROPERTIES LABELS ${ARG_LABELS} TIMEOUT ${APVI_TEST_TIMEOUT})
endfunction()

# apvi_add_torch_test(<module> SOURCES a_test.cpp ... [DEPENDS ...] [LABELS ...])
# defines one test program for a module that uses LibTorch; every suite is a separate CTest case (not
# every TEST, since a process with LibTorch takes 0.4 s to start).
function(apvi_add_torch_test name)
  cmake_parse_arguments(ARG "" "LABELS" "SOURCES;DEPENDS" ${ARGN})
  if(NOT ARG_LABELS)
    set(ARG_LABELS quick)
  endif()
  apvi_make_test_program(${name} "${ARG_SOURCES}" "${ARG_DEPENDS}")
  apvi_precompile_torch(apvi_${name}_test)
  set(suites)
  foreach(source IN LISTS ARG_SOURCES)
    set_property(DIRECTORY APPEND PROPERTY CMAKE_CONFIGURE_DEPENDS "${CMAKE_CURRENT_SOURCE_DIR}/${source}")
    file(STRINGS ${source} lines REGEX "^(TYPED_)?TEST(_F|_P)?\\(")
    list(TRANSFORM lines REPLACE "^[A-Z_]+\\(([A-Za-z0-9]+),.*" "\\1")
    list(APPEND suites ${lines})
  endforeach()
  list(REMOVE_DUPLICATES suites)
  foreach(suite IN LISTS suites)
    add_test(NAME ${name}/${suite}
             COMMAND apvi_${name}_test --gtest_filter=${suite}.*:${suite}/*:*/${suite}.*)
    set_tests_properties(${name}/${suite} PROPERTIES LABELS ${ARG_LABELS} TIMEOUT ${APVI_TEST_TIMEOUT}
                         FAIL_REGULAR_EXPRESSION "Running 0 tests")
  endforeach()
endfunction()
