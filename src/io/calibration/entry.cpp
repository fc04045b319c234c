// SPDX-License-Identifier: BSD-3-Clause
#include "io/calibration/entry.hpp"

#include <fmt/format.h>

#include <Eigen/Core>
#include <cmath>

#include "apvi/geometry/so3.hpp"
#include "core/text.hpp"

namespace apvi::io {
namespace {

using config::Node;

void append_numbers(const Node& node, const std::string& key, std::vector<double>& numbers) {
  if (node.kind == Node::Kind::list) {
    for (const Node& item : node.items) append_numbers(item, key, numbers);
  } else {
    numbers.push_back(number_of({&node, key}));
  }
}

Node with_place(Node::Kind kind, const Node& place) {
  Node node;
  node.kind = kind;
  node.source = place.source;
  node.line = place.line;
  return node;
}

std::string join(std::string_view path, std::string_view name) {
  return path.empty() ? std::string(name) : fmt::format("{}.{}", path, name);
}

}  // namespace

std::optional<Entry> find_entry(const Node& parent, std::string_view path, std::string_view name) {
  const Node* node = parent.find(name);
  if (node == nullptr || node->is_null()) return std::nullopt;
  return Entry{node, join(path, name)};
}

Entry require_entry(const Node& parent, std::string_view path, std::string_view name,
                    std::string_view expected) {
  if (auto entry = find_entry(parent, path, name)) return *entry;
  fail_at(parent, join(path, name), fmt::format("missing; expected {}", expected));
}

double number_of(const Entry& entry) {
  const Node& node = *entry.node;
  const auto number =
      node.kind == Node::Kind::scalar ? text::parse_double(node.text) : std::nullopt;
  if (!number || !std::isfinite(*number)) {
    fail_at(node, entry.key,
            fmt::format("expected a number{}{}", node.text.empty() ? "" : ", got ", node.text));
  }
  return *number;
}

const std::string& word_of(const Entry& entry) {
  if (entry.node->kind != Node::Kind::scalar) fail_at(*entry.node, entry.key, "expected a word");
  return entry.node->text;
}

std::vector<double> numbers_of(const Entry& entry) {
  const Node* data = entry.node;
  if (data->kind == Node::Kind::map) data = data->find("data");
  if (data == nullptr || data->kind != Node::Kind::list) {
    fail_at(*entry.node, entry.key, "expected a list of numbers, or {rows, cols, data}");
  }
  std::vector<double> numbers;
  append_numbers(*data, entry.key, numbers);
  return numbers;
}

std::vector<double> numbers_of(const Entry& entry, std::size_t count, std::string_view names) {
  std::vector<double> numbers = numbers_of(entry);
  if (numbers.size() != count) {
    fail_at(*entry.node, entry.key,
            fmt::format("expected {} numbers ({}), got {}", count, names, numbers.size()));
  }
  return numbers;
}

SE3 pose_of(const Entry& entry) {
  std::vector<double> m = numbers_of(entry);
  if (m.size() == 12) m.insert(m.end(), {0.0, 0.0, 0.0, 1.0});
  if (m.size() != 16) {
    fail_at(*entry.node, entry.key,
            fmt::format("expected 16 numbers, row by row, got {}", m.size()));
  }
  const auto matrix = Eigen::Map<const Eigen::Matrix<double, 4, 4, Eigen::RowMajor>>(m.data());
  const auto rotation = so3::nearest_rotation(matrix.topLeftCorner<3, 3>());
  const bool affine = (matrix.row(3) - Eigen::RowVector4d(0, 0, 0, 1)).norm() < 1e-6;
  if (!rotation || !affine) {
    fail_at(*entry.node, entry.key,
            "expected a rigid transform: a rotation, a position in the last column, and 0, 0, 0, "
            "1 as the last row");
  }
  return {Eigen::Quaterniond(*rotation).normalized(), matrix.topRightCorner<3, 1>()};
}

Node section_at(const Node& place) {
  return with_place(Node::Kind::map, place);
}

Node word_at(std::string_view word, const Node& place) {
  Node node = with_place(Node::Kind::scalar, place);
  node.text = word;
  return node;
}

Node number_at(double number, const Node& place) {
  return word_at(fmt::format("{}", number), place);
}

Node numbers_at(const std::vector<double>& numbers, const Node& place) {
  Node node = with_place(Node::Kind::list, place);
  for (const double number : numbers) node.items.push_back(number_at(number, place));
  return node;
}

Node pose_at(const SE3& pose, const Node& place) {
  const Eigen::Matrix<double, 4, 4, Eigen::RowMajor> matrix = pose.matrix();
  return numbers_at({matrix.data(), matrix.data() + 16}, place);
}

void copy_numbers(const Node& from, std::string_view path, const std::vector<RenamedKey>& keys,
                  Node& section) {
  for (const auto& [theirs, ours] : keys) {
    const auto entry = find_entry(from, path, theirs);
    if (!entry) continue;
    number_of(*entry);
    section.member(ours) = *entry->node;
  }
}

void copy_list(const Node& from, std::string_view path, std::string_view key, std::size_t count,
               std::string_view names, Node& section) {
  const auto entry = find_entry(from, path, key);
  if (entry) section.member(key) = numbers_at(numbers_of(*entry, count, names), *entry->node);
}

}  // namespace apvi::io
