# SPDX-License-Identifier: BSD-3-Clause
# `cpack --config build/cpu/CPackConfig.cmake` makes a Debian package of the program, for the release that it was
# built on: dpkg-shlibdeps names the libraries.

set(CPACK_GENERATOR DEB)
set(CPACK_PACKAGE_NAME apvi)
set(CPACK_PACKAGE_VENDOR "The APVI-SLAM developers")
set(CPACK_PACKAGE_CONTACT "The APVI-SLAM developers <maintainers@apvi-slam.invalid>")
set(CPACK_PACKAGE_DESCRIPTION_SUMMARY "localization and mapping for underwater vehicles")
set(CPACK_PACKAGING_INSTALL_PREFIX /usr)
set(CPACK_PACKAGE_DIRECTORY "${PROJECT_BINARY_DIR}/packages")
set(CPACK_STRIP_FILES ON)
set(CPACK_COMPONENTS_ALL program)
set(CPACK_DEB_COMPONENT_INSTALL ON)
set(CPACK_INSTALL_DEFAULT_DIRECTORY_PERMISSIONS
    OWNER_READ OWNER_WRITE OWNER_EXECUTE GROUP_READ GROUP_EXECUTE WORLD_READ WORLD_EXECUTE)

set(CPACK_DEBIAN_PACKAGE_NAME apvi)
set(CPACK_DEBIAN_PROGRAM_PACKAGE_NAME apvi)
set(CPACK_DEBIAN_FILE_NAME DEB-DEFAULT)
set(CPACK_DEBIAN_PACKAGE_SECTION science)
set(CPACK_DEBIAN_PROGRAM_DESCRIPTION
"APVI-SLAM estimates the trajectory of an underwater vehicle from a camera,
an IMU, a DVL and a pressure sensor, and builds a map of 3-D Gaussians that
models the water.
.
It reads ROS 1 and ROS 2 bags, videos and folders of images and csv files,
simulates dives, checks recordings, and shows maps in a browser.")
set(CPACK_DEBIAN_PACKAGE_SHLIBDEPS ON)
set(CPACK_DEBIAN_PACKAGE_RECOMMENDS "python3, python3-jinja2, python3-matplotlib, python3-numpy")  # report.html

include(CPack)
