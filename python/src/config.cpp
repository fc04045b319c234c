// SPDX-License-Identifier: BSD-3-Clause
#include <pybind11/stl.h>

#include "apvi/core/error.hpp"
#include "bindings.hpp"
#include "config/renamed_keys.hpp"
#include "nodes.hpp"
#include "options.hpp"

namespace apvi::python {
namespace {

using config::Node;
using Overrides = std::vector<std::string>;

Options read_options(const Node& node) {
  Options options;
  config::read(node, options.config);
  runs::slam_options(options.config).check();
  return options;
}

Node from_dict(const py::handle& dict, const Overrides& overrides) {
  config::KeyRenamer renamer(config::run_renames());
  Node node = to_node(dict, "options");
  renamer.apply(node);
  for (const std::string& assignment : overrides) renamer.apply_override(node, assignment);
  return node;
}

std::filesystem::path find_file(const std::filesystem::path& name) {
  const std::filesystem::path ours = configurations() / name;
  return !std::filesystem::exists(name) && std::filesystem::exists(ours) ? ours : name;
}

Options make_options(const py::object& source, const Overrides& overrides) {
  if (source.is_none()) return read_options(from_dict(py::dict(), overrides));
  if (py::isinstance<py::dict>(source)) return read_options(from_dict(source, overrides));
  if (!is_path(source)) fail_input("options: expected the path of a file, a dict, or None");
  return read_options(config::load_config(find_file(to_path(source)), overrides,
                                          config::run_renames(), {configurations()}));
}

std::string current_name(const std::string& key) {
  return config::KeyRenamer(config::run_renames()).renamed(key);
}

py::object get(const Options& options, const std::string& key) {
  const Node root = config::to_node(options.config);
  const Node* node = &root;
  std::string rest = current_name(key);
  while (node != nullptr && !rest.empty()) {
    const std::size_t dot = rest.find('.');
    node = node->find(rest.substr(0, dot));
    rest = dot == std::string::npos ? "" : rest.substr(dot + 1);
  }
  if (node == nullptr) throw py::key_error(key);
  return to_object(*node);
}

void set(Options& options, const std::string& key, const py::handle& value) {
  Node root = config::to_node(options.config);
  config::set_value(root, current_name(key), to_node(value, "options"));
  options = read_options(root);
}

}  // namespace

void bind_config(py::module_& m) {
  py::class_<Options>(m, "Options", "The configuration of a run; its keys are in docs/config.md.")
      .def(py::init(&make_options), py::arg("source") = py::none(), py::pos_only(),
           py::arg("set") = Overrides(),
           "From a YAML file, a nested dict, or the defaults; then `set`: \"key=value\" in order.\n"
           "Raises InputError for unknown keys, values out of range and contradictions.")
      .def("__getitem__", &get, py::arg("key"), "The value of a dotted key, or a section as dict.")
      .def("__setitem__", &set, py::arg("key"), py::arg("value"))
      .def(
          "to_dict", [](const Options& o) { return to_object(config::to_node(o.config)); },
          "All values, defaults included.")
      .def("to_yaml", [](const Options& o) { return config::to_yaml(config::to_node(o.config)); });
}

}  // namespace apvi::python
