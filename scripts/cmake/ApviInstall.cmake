# SPDX-License-Identifier: BSD-3-Clause
# `cmake --install` installs a package for find_package(apvi), with targets apvi::<module>.
# tests/install builds a program against it.

include(CMakePackageConfigHelpers)

install(DIRECTORY "${PROJECT_SOURCE_DIR}/include/apvi"
        DESTINATION "${CMAKE_INSTALL_INCLUDEDIR}" FILES_MATCHING PATTERN "*.hpp")
install(DIRECTORY "${PROJECT_SOURCE_DIR}/configs" DESTINATION "${CMAKE_INSTALL_DATADIR}/apvi")
install(DIRECTORY "${PROJECT_SOURCE_DIR}/scripts/report"
        DESTINATION "${CMAKE_INSTALL_DATADIR}/apvi/scripts" PATTERN "__pycache__" EXCLUDE)
install(PROGRAMS "${PROJECT_SOURCE_DIR}/scripts/report.py"
        DESTINATION "${CMAKE_INSTALL_DATADIR}/apvi/scripts")
set(APVI_INSTALL_CMAKEDIR "${CMAKE_INSTALL_LIBDIR}/cmake/apvi")
install(EXPORT apviTargets NAMESPACE apvi:: DESTINATION "${APVI_INSTALL_CMAKEDIR}")
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
  "${PROJECT_SOURCE_DIR}/scripts/cmake/ApviTorch.cmake"
  DESTINATION "${APVI_INSTALL_CMAKEDIR}")
