// SPDX-License-Identifier: BSD-3-Clause
#include "apvi/version.hpp"
#include "bindings.hpp"

PYBIND11_MODULE(_apvi, m) {
  using namespace apvi::python;
  m.doc() = "Localization and mapping under water; see the package apvi";
  m.attr("__version__") = apvi::kVersion;
  m.attr("git_revision") = apvi::kGitRevision;
  m.attr("backend") = apvi::kBackend;
  bind_errors(m);
  bind_config(m);
  bind_trajectory(m);
  bind_rig(m);
  bind_samples(m);
  bind_readers(m);
  bind_ros(m);
  bind_map(m);
  bind_system(m);
  bind_mapper(m);
  bind_evaluation(m);
  bind_doctor(m);
}
