# SPDX-License-Identifier: BSD-3-Clause
# Writes version.hpp into the build tree, with the git revision at build time, or that of the archive
# (`git archive` writes it into archive_revision.txt). When included by the project, adds the target
# apvi_version, which runs this file as a script (cmake -P).

function(apvi_write_version_header output)
  find_package(Git QUIET)
  set(APVI_GIT_REVISION "unknown")
  file(STRINGS "${APVI_VERSION_SOURCE}/scripts/cmake/archive_revision.txt" archived REGEX "^[0-9a-f]+$")
  if(archived)
    string(SUBSTRING "${archived}" 0 12 APVI_GIT_REVISION)
  elseif(Git_FOUND AND EXISTS "${APVI_VERSION_SOURCE}/.git")
    execute_process(COMMAND ${GIT_EXECUTABLE} describe --always --dirty --abbrev=12
                    WORKING_DIRECTORY "${APVI_VERSION_SOURCE}" RESULT_VARIABLE failed
                    OUTPUT_VARIABLE revision OUTPUT_STRIP_TRAILING_WHITESPACE ERROR_QUIET)
    if(NOT failed)
      set(APVI_GIT_REVISION "${revision}")
    endif()
  endif()
  # Only rewrites the file when its content changes, to avoid needless recompilation.
  configure_file("${APVI_VERSION_SOURCE}/include/apvi/version.hpp.in" "${output}" @ONLY)
endfunction()

if(CMAKE_SCRIPT_MODE_FILE)
  apvi_write_version_header("${APVI_VERSION_HEADER}")
  return()
endif()

set(APVI_VERSION_SOURCE "${PROJECT_SOURCE_DIR}")
set(APVI_GENERATED_INCLUDE_DIR "${PROJECT_BINARY_DIR}/generated/include")
set(APVI_VERSION_HEADER "${APVI_GENERATED_INCLUDE_DIR}/apvi/version.hpp")
set(APVI_TORCH_VERSION "${Torch_VERSION}")
apvi_write_version_header("${APVI_VERSION_HEADER}")
add_custom_target(apvi_version
  COMMAND ${CMAKE_COMMAND}
          "-DAPVI_VERSION_SOURCE=${APVI_VERSION_SOURCE}" "-DAPVI_VERSION_HEADER=${APVI_VERSION_HEADER}"
          "-DAPVI_BACKEND=${APVI_BACKEND}" "-DPROJECT_VERSION=${PROJECT_VERSION}"
          "-DAPVI_TORCH_VERSION=${APVI_TORCH_VERSION}"
          -P "${CMAKE_CURRENT_LIST_FILE}"
  BYPRODUCTS "${APVI_VERSION_HEADER}"
  COMMENT "Checking the git revision" VERBATIM)
install(FILES "${APVI_VERSION_HEADER}" DESTINATION "${CMAKE_INSTALL_INCLUDEDIR}/apvi" COMPONENT development)
