// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <pybind11/pybind11.h>

/// The extension module apvi._apvi: the C++ API with numpy arrays at its boundary. Each function
/// adds the classes of one subject to the module. C++ works without Python's global lock.
namespace apvi::python {

namespace py = pybind11;

void bind_errors(py::module_& m);
void bind_config(py::module_& m);
void bind_trajectory(py::module_& m);
void bind_rig(py::module_& m);
void bind_samples(py::module_& m);
void bind_readers(py::module_& m);
void bind_ros(py::module_& m);
void bind_map(py::module_& m);
void bind_system(py::module_& m);
void bind_mapper(py::module_& m);
void bind_evaluation(py::module_& m);
void bind_doctor(py::module_& m);

}  // namespace apvi::python
