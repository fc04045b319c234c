// SPDX-License-Identifier: BSD-3-Clause
#include <nlohmann/json.hpp>

#include "apvi/config/fields.hpp"
#include "apvi/core/error.hpp"
#include "bindings.hpp"
#include "eval/metrics_file.hpp"
#include "nodes.hpp"

namespace apvi::python {
namespace {

WorldFrame world_named(const std::string& name) {
  if (name != "up" && name != "ned") fail_input("world: {} is not up or ned", name);
  return name == "ned" ? WorldFrame::ned : WorldFrame::up;
}

py::object evaluate(const Trajectory& reference, const Trajectory& estimate,
                    const std::string& world, const py::kwargs& settings) {
  eval::EvalOptions options;
  config::read(to_node(settings, "evaluate"), options, "eval");
  options.estimate_world = world_named(world);
  options.reference_world = eval::reference_world(reference, options.estimate_world);
  std::string text;
  {
    const py::gil_scoped_release unlocked;
    text = eval::to_json(eval::evaluate(reference, estimate, options)).dump();
  }
  return py::module_::import("json").attr("loads")(text);
}

}  // namespace

void bind_evaluation(py::module_& m) {
  m.def("evaluate", &evaluate, py::arg("reference"), py::arg("estimate"), py::kw_only(),
        py::arg("world") = "up",
        "Metrics of an estimate as in the section `trajectory` of metrics.json; those that cannot\n"
        "be computed are absent. Keyword arguments are the keys of the section `eval`.");
}

}  // namespace apvi::python
