// SPDX-License-Identifier: BSD-3-Clause
#include "apvi/core/error.hpp"

#include <map>
#include <string>

#include "apvi/core/log.hpp"
#include "bindings.hpp"

namespace apvi::python {
namespace {

void set_log_level(const std::string& name) {
  static const std::map<std::string, log::Level> levels = {{"debug", log::Level::debug},
                                                           {"info", log::Level::info},
                                                           {"warning", log::Level::warning},
                                                           {"error", log::Level::error}};
  const auto found = levels.find(name);
  if (found == levels.end()) fail_input("log level {}: not debug, info, warning or error", name);
  log::set_console_level(found->second);
}

}  // namespace

// The translator of a base class is registered first, since the last one is tried first.
void bind_errors(py::module_& m) {
  const auto error = py::register_exception<Error>(m, "Error", PyExc_RuntimeError);
  py::register_exception<InputError>(m, "InputError", error);
  py::register_exception<RunError>(m, "RunError", error);
  m.def("set_log_level", &set_log_level, py::arg("level"),
        "Lowest level of messages on standard error: debug, info (default), warning or error.");
}

}  // namespace apvi::python
