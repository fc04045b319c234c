// SPDX-License-Identifier: BSD-3-Clause
#include "doctor/doctor.hpp"

#include <pybind11/stl.h>
#include <pybind11/stl/filesystem.h>

#include "bindings.hpp"
#include "options.hpp"

namespace apvi::python {
namespace {

using doctor::Finding;
using doctor::Report;
using doctor::Severity;

// Whether Python has a pending signal, such as that of Ctrl-C.
bool interrupted() {
  const py::gil_scoped_acquire acquire;
  return PyErr_CheckSignals() != 0;
}

Report examine(const std::filesystem::path& path, const Options& options) {
  io::DatasetConfig dataset = options.config.dataset;
  dataset.path = path.string();
  bool ended_early = false;
  Report report;
  {
    const py::gil_scoped_release unlocked;
    const auto stop = [&ended_early] { return ended_early || (ended_early = interrupted()); };
    report = doctor::examine(dataset, {.progress = {}, .interrupted = stop});
  }
  if (ended_early) throw py::error_already_set();
  return report;
}

}  // namespace

void bind_doctor(py::module_& m) {
  py::class_<Finding>(m, "Finding", "Result of one check of a recording.")
      .def_property_readonly(
          "severity", [](const Finding& f) { return to_string(f.severity); },
          "ok, note, warning or error")
      .def_readonly("sensor", &Finding::sensor)
      .def_readonly("check", &Finding::check)
      .def_readonly("message", &Finding::message)
      .def_readonly("advice", &Finding::advice)
      .def_property_readonly("values", [](const Finding& f) {
        py::dict values;
        for (const auto& [name, value] : f.values) values[py::str(name)] = value;
        return values;
      });
  py::class_<Report>(m, "Report", "What is wrong with a recording or its calibration.")
      .def_readonly("findings", &Report::findings)
      .def_property_readonly("errors", [](const Report& r) { return r.count(Severity::error); })
      .def_property_readonly("warnings", [](const Report& r) { return r.count(Severity::warning); })
      .def("__str__", [](const Report& r) { return doctor::to_text(r); });
  m.def("examine", &examine, py::arg("path"), py::arg("options") = Options(),
        "Checks a recording and its calibration, as `apvi doctor` does. Uses the section dataset.");
}

}  // namespace apvi::python
