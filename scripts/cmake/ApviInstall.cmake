# SPDX-License-Identifier: BSD-3-Clause
# What `cmake --install` installs, in two components:
#   program      the program, its configurations, scripts, man page and licenses
#   development  libraries, headers, and a package for find_package(apvi) with targets apvi::<module>
# tests/install runs the program and builds another one against the libraries.

include(CMakePackageConfigHelpers)

set(apvi_data "${CMAKE_INSTALL_DATADIR}/apvi")
set(apvi_doc "${CMAKE_INSTALL_DATADIR}/doc/apvi")

# The license of the project and the notices of others, in the file where Debian looks for them.
file(READ "${PROJECT_SOURCE_DIR}/LICENSE" apvi_license)
file(READ "${PROJECT_SOURCE_DIR}/third_party/NOTICES.txt" apvi_notices)
file(CONFIGURE OUTPUT "${PROJECT_BINARY_DIR}/generated/copyright" @ONLY
     CONTENT "@apvi_license@\n@apvi_notices@")

if(TARGET apvi)
  install(DIRECTORY "${PROJECT_SOURCE_DIR}/configs" DESTINATION "${apvi_data}" COMPONENT program)
  install(DIRECTORY "${PROJECT_SOURCE_DIR}/scripts/report" DESTINATION "${apvi_data}/scripts"
          COMPONENT program PATTERN "__pycache__" EXCLUDE)
  foreach(script IN ITEMS explain_run.py make_lpips_weights.py plot_calibration.py report.py)
    install(PROGRAMS "${PROJECT_SOURCE_DIR}/scripts/${script}" DESTINATION "${apvi_data}/scripts"
            COMPONENT program)
  endforeach()
  install(FILES "${PROJECT_BINARY_DIR}/generated/copyright" "${PROJECT_SOURCE_DIR}/CHANGELOG.md"
          DESTINATION "${apvi_doc}" COMPONENT program)

  # Made when installing, since it takes 10 s to ask the program for its help.
  find_program(APVI_MAN_PAGE_PYTHON python3 REQUIRED)
  set(apvi_man_page "${PROJECT_BINARY_DIR}/generated/apvi.1.gz")
  install(CODE "execute_process(COMMAND \"${APVI_MAN_PAGE_PYTHON}\" \"${PROJECT_SOURCE_DIR}/scripts/man_page.py\"
                  \"$<TARGET_FILE:apvi>\" \"${apvi_man_page}\" COMMAND_ERROR_IS_FATAL ANY)"
          COMPONENT program)
  install(FILES "${apvi_man_page}" DESTINATION "${CMAKE_INSTALL_MANDIR}/man1" COMPONENT program)
endif()

install(DIRECTORY "${PROJECT_SOURCE_DIR}/include/apvi" DESTINATION "${CMAKE_INSTALL_INCLUDEDIR}"
        COMPONENT development FILES_MATCHING PATTERN "*.hpp")
set(APVI_INSTALL_CMAKEDIR "${CMAKE_INSTALL_LIBDIR}/cmake/apvi")
install(EXPORT apviTargets NAMESPACE apvi:: DESTINATION "${APVI_INSTALL_CMAKEDIR}"
        COMPONENT development)
configure_package_config_file(scripts/cmake/apviConfig.cmake.in
  "${PROJECT_BINARY_DIR}/generated/cmake/apviConfig.cmake"
  INSTALL_DESTINATION "${APVI_INSTALL_CMAKEDIR}"
  NO_SET_AND_CHECK_MACRO NO_CHECK_REQUIRED_COMPONENTS_MACRO)
write_basic_package_version_file("${PROJECT_BINARY_DIR}/generated/cmake/apviConfigVersion.cmake"
  COMPATIBILITY SameMinorVersion)
install(FILES
  "${PROJECT_BINARY_DIR}/generated/cmake/apviConfig.cmake"
  "${PROJECT_BINARY_DIR}/generated/cmake/apviConfigVersion.cmake"
  "${PROJECT_SOURCE_DIR}/scripts/cmake/ApviDependencies.cmake"
  "${PROJECT_SOURCE_DIR}/scripts/cmake/ApviRosbag.cmake"
  "${PROJECT_SOURCE_DIR}/scripts/cmake/ApviRosbag2.cmake"
  "${PROJECT_SOURCE_DIR}/scripts/cmake/ApviSurvey.cmake"
  "${PROJECT_SOURCE_DIR}/scripts/cmake/ApviTorch.cmake"
  DESTINATION "${APVI_INSTALL_CMAKEDIR}" COMPONENT development)

include(ApviPackage)
