# SPDX-License-Identifier: BSD-3-Clause
"""Types of the module that CMake writes."""
LIBTORCH: str
TORCH_VERSION: str
PYBIND11_VERSION: str
