// SPDX-License-Identifier: BSD-3-Clause
#include "nodes.hpp"

#include <pybind11/stl/filesystem.h>

#include <memory>
#include <utility>

#include "apvi/core/error.hpp"
#include "core/text.hpp"

namespace apvi::python {
namespace {

using config::Node;
using Source = std::shared_ptr<const std::string>;

Node convert(const py::handle& value, const Source& source);

Node scalar(std::string text, const Source& source) {
  Node node;
  node.kind = Node::Kind::scalar;
  node.text = std::move(text);
  node.source = source;
  return node;
}

Node convert_map(const py::dict& dict, const Source& source) {
  Node node;
  node.kind = Node::Kind::map;
  node.source = source;
  for (const auto& [key, value] : dict) {
    if (!py::isinstance<py::str>(key)) config::fail_at(node, "", "a key must be a str");
    node.members.emplace_back(py::str(key), convert(value, source));
  }
  return node;
}

Node convert_list(const py::handle& values, const Source& source) {
  Node node;
  node.kind = Node::Kind::list;
  node.source = source;
  for (const py::handle item : values) node.items.push_back(convert(item, source));
  return node;
}

Node convert(const py::handle& value, const Source& source) {
  if (value.is_none()) return {};
  if (py::isinstance<py::bool_>(value))
    return scalar(value.cast<bool>() ? "true" : "false", source);
  if (py::isinstance<py::dict>(value)) return convert_map(value.cast<py::dict>(), source);
  if (py::hasattr(value, "tolist")) return convert(value.attr("tolist")(), source);  // numpy
  if (py::isinstance<py::list>(value) || py::isinstance<py::tuple>(value)) {
    return convert_list(value, source);
  }
  if (is_path(value)) return scalar(to_path(value).string(), source);
  if (py::isinstance<py::int_>(value) || py::isinstance<py::float_>(value)) {
    return scalar(py::repr(value), source);
  }
  fail_input("{}: a value of type {} is not a configuration value", *source,
             std::string(py::str(py::type::of(value))));
}

py::object to_scalar(const std::string& text) {
  if (text == "true") return py::bool_(true);
  if (text == "false") return py::bool_(false);
  if (const auto whole = text::parse_int64(text)) return py::int_(*whole);
  if (const auto number = text::parse_double(text)) return py::float_(*number);
  return py::str(text);
}

}  // namespace

Node to_node(const py::handle& value, const std::string& source) {
  return convert(value, std::make_shared<const std::string>(source));
}

py::object to_object(const Node& node) {
  if (node.kind == Node::Kind::scalar) return to_scalar(node.text);
  if (node.kind == Node::Kind::list) {
    py::list list;
    for (const Node& item : node.items) list.append(to_object(item));
    return list;
  }
  if (node.kind == Node::Kind::map) {
    py::dict dict;
    for (const auto& [key, member] : node.members) dict[py::str(key)] = to_object(member);
    return dict;
  }
  return py::none();
}

bool is_path(const py::handle& value) {
  return py::isinstance<py::str>(value) || py::hasattr(value, "__fspath__");
}

std::filesystem::path to_path(const py::handle& value) {
  return value.cast<std::filesystem::path>();
}

std::filesystem::path configurations() {
  const py::module_ module = py::module_::import("apvi._apvi");
  return to_path(module.attr("__file__")).parent_path() / "configs";
}

}  // namespace apvi::python
