// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <array>
#include <cmath>
#include <cstddef>
#include <initializer_list>
#include <limits>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <type_traits>
#include <utility>
#include <vector>

#include "apvi/config/node.hpp"

/// Declarative configuration. A struct lists its fields once, in a `visit` method:
///
///     struct TrackerConfig {
///       double min_distance_px = 20.0;
///       Mode mode = Mode::paper;
///       template <typename V>
///       void visit(V& v) {
///         v("min_distance_px", min_distance_px, Range{1.0, 200.0}, "corner spacing [px]");
///         v("mode", mode, Choices<Mode>{{"paper", Mode::paper}}, "form of Eq. 7");
///       }
///     };
///
/// and can then be read from a Node (`read`), converted to one (`to_node`) and documented
/// (`document`). A field is a bool, int, double, string, enum, nested struct, raw Node, or an
/// optional, vector, array or string-keyed map of these. Defaults are the member initializers.
namespace apvi::config {

/// Closed interval for a number, or for every number of a list.
template <typename T>
struct Range {
  T low;
  T high;
};
template <typename T>
Range(T, T) -> Range<T>;

/// Names of the values of an enum.
template <typename E>
struct Choices : std::vector<std::pair<std::string_view, E>> {
  using std::vector<std::pair<std::string_view, E>>::vector;
};

/// One row of the generated documentation.
struct FieldDoc {
  std::string key;
  std::string type;
  std::string default_value;
  std::string range;
  std::string doc;
};

namespace internal {

struct AnyVisitor {
  template <typename... Args>
  void operator()(Args&&...) {}
};

// C++17, so that clang-tidy 14 can parse sources that include LibTorch as well.
template <typename T, typename = void>
inline constexpr bool is_visitable = false;
template <typename T>
inline constexpr bool
    is_visitable<T, std::void_t<decltype(std::declval<T&>().visit(std::declval<AnyVisitor&>()))>> =
        true;
template <typename T>
inline constexpr bool is_vector = false;
template <typename T>
inline constexpr bool is_vector<std::vector<T>> = true;
template <typename T>
inline constexpr bool is_array = false;
template <typename T, std::size_t N>
inline constexpr bool is_array<std::array<T, N>> = true;
template <typename T>
inline constexpr bool is_optional = false;
template <typename T>
inline constexpr bool is_optional<std::optional<T>> = true;
template <typename T>
inline constexpr bool is_map = false;
template <typename T>
inline constexpr bool is_map<std::map<std::string, T>> = true;

struct NoLimit {};

// Non-template helpers, in fields.cpp.
void read_scalar(const Node& node, const std::string& key, bool& value);
void read_scalar(const Node& node, const std::string& key, int& value);
void read_scalar(const Node& node, const std::string& key, double& value);
void read_scalar(const Node& node, const std::string& key, std::string& value);
[[noreturn]] void fail_out_of_range(const Node& node, const std::string& key,
                                    const std::string& value, const std::string& low,
                                    const std::string& high);
[[noreturn]] void fail_unknown_choice(const Node& node, const std::string& key,
                                      const std::vector<std::string>& words);
void check_known_keys(const Node& node, const std::string& path,
                      const std::vector<std::string>& known);
std::string format_number(double value);
std::string format_number(int value);
Node scalar_node(std::string text);
std::string join(const std::string& path, std::string_view name);

template <typename T>
void check_limit(const Node&, const std::string&, const T&, NoLimit) {}

template <typename T, typename R>
void check_limit(const Node& node, const std::string& key, T value, const Range<R>& range) {
  if (value < static_cast<T>(range.low) || value > static_cast<T>(range.high)) {
    fail_out_of_range(node, key, format_number(value), format_number(static_cast<T>(range.low)),
                      format_number(static_cast<T>(range.high)));
  }
}

template <typename T, typename Limit>
void read_value(const Node& node, const std::string& key, T& value, const Limit& limit);

template <typename E>
void read_enum(const Node& node, const std::string& key, E& value, const Choices<E>& choices) {
  std::string word;
  read_scalar(node, key, word);
  std::vector<std::string> words;
  for (const auto& [name, choice] : choices) {
    if (name == word) {
      value = choice;
      return;
    }
    words.emplace_back(name);
  }
  fail_unknown_choice(node, key, words);
}

template <typename List, typename Limit>
void read_list(const Node& node, const std::string& key, List& list, const Limit& limit) {
  if (node.kind != Node::Kind::list) fail_at(node, key, "expected a list, such as [1, 2, 3]");
  if constexpr (is_vector<List>) {
    list.assign(node.items.size(), {});
  } else if (node.items.size() != list.size()) {
    fail_at(node, key,
            "expected " + format_number(static_cast<int>(list.size())) + " values, got " +
                format_number(static_cast<int>(node.items.size())));
  }
  for (std::size_t i = 0; i < node.items.size(); ++i) {
    read_value(node.items[i], key + "[" + format_number(static_cast<int>(i)) + "]", list[i], limit);
  }
}

/// Visitor that fills a struct from a map and rejects unknown keys.
class Reader {
 public:
  Reader(const Node& node, std::string path) : node_(node), path_(std::move(path)) {}

  template <typename T>
  void operator()(std::string_view name, T& value, std::string_view) {
    read_member(name, value, NoLimit{});
  }
  template <typename T, typename Limit>
  void operator()(std::string_view name, T& value, const Limit& limit, std::string_view) {
    read_member(name, value, limit);
  }
  void finish() const { check_known_keys(node_, path_, known_); }

 private:
  template <typename T, typename Limit>
  void read_member(std::string_view name, T& value, const Limit& limit) {
    known_.emplace_back(name);
    if (const Node* member = node_.find(name)) read_value(*member, join(path_, name), value, limit);
  }

  const Node& node_;
  std::string path_;
  std::vector<std::string> known_;
};

template <typename T>
void read_struct(const Node& node, const std::string& path, T& value) {
  if (node.is_null()) return;
  if (node.kind != Node::Kind::map) fail_at(node, path, "expected nested keys");
  Reader reader(node, path);
  value.visit(reader);
  reader.finish();
}

template <typename T, typename Limit>
void read_value(const Node& node, const std::string& key, T& value, const Limit& limit) {
  if constexpr (std::is_same_v<T, Node>) {
    value = node;
  } else if constexpr (is_visitable<T>) {
    read_struct(node, key, value);
  } else if constexpr (is_optional<T>) {
    if (node.is_null()) {
      value.reset();
    } else {
      // Start from the struct's defaults, not from the previous value.
      typename T::value_type inner{};
      read_value(node, key, inner, limit);
      value = std::move(inner);
    }
  } else if constexpr (is_map<T>) {
    if (node.kind != Node::Kind::map) fail_at(node, key, "expected nested keys");
    for (const auto& [name, member] : node.members) {
      read_value(member, join(key, name), value[name], limit);
    }
  } else if constexpr (is_vector<T> || is_array<T>) {
    read_list(node, key, value, limit);
  } else if constexpr (std::is_enum_v<T>) {
    read_enum(node, key, value, limit);
  } else {
    read_scalar(node, key, value);
    if constexpr (std::is_arithmetic_v<T> && !std::is_same_v<T, bool>) {
      check_limit(node, key, value, limit);
    }
  }
}

template <typename T, typename Limit>
Node value_to_node(const T& value, const Limit& limit);

/// Visitor that converts a struct to a map.
class Writer {
 public:
  Writer() { node.kind = Node::Kind::map; }
  template <typename T>
  void operator()(std::string_view name, T& value, std::string_view) {
    node.member(name) = value_to_node(value, NoLimit{});
  }
  template <typename T, typename Limit>
  void operator()(std::string_view name, T& value, const Limit& limit, std::string_view) {
    node.member(name) = value_to_node(value, limit);
  }
  Node node;
};

template <typename T, typename Limit>
Node value_to_node(const T& value, const Limit& limit) {
  if constexpr (std::is_same_v<T, Node>) {
    return value;
  } else if constexpr (is_visitable<T>) {
    Writer writer;
    T copy = value;  // visit is not const: one method serves reading and writing
    copy.visit(writer);
    return writer.node;
  } else if constexpr (is_optional<T>) {
    return value ? value_to_node(*value, limit) : Node{};
  } else if constexpr (is_map<T>) {
    Writer writer;
    for (const auto& [name, member] : value)
      writer.node.member(name) = value_to_node(member, limit);
    return writer.node;
  } else if constexpr (is_vector<T> || is_array<T>) {
    Node node;
    node.kind = Node::Kind::list;
    for (const auto& item : value) node.items.push_back(value_to_node(item, limit));
    return node;
  } else if constexpr (std::is_enum_v<T>) {
    for (const auto& [name, choice] : limit) {
      if (choice == value) return scalar_node(std::string(name));
    }
    return Node{};
  } else if constexpr (std::is_same_v<T, bool>) {
    return scalar_node(value ? "true" : "false");
  } else if constexpr (std::is_same_v<T, std::string>) {
    return scalar_node(value);
  } else {
    return scalar_node(format_number(value));
  }
}

/// Visitor that lists keys with types, defaults, ranges and descriptions.
class Documenter {
 public:
  explicit Documenter(std::string path) : path_(std::move(path)) {}

  template <typename T>
  void operator()(std::string_view name, T& value, std::string_view doc) {
    add(name, value, NoLimit{}, doc);
  }
  template <typename T, typename Limit>
  void operator()(std::string_view name, T& value, const Limit& limit, std::string_view doc) {
    add(name, value, limit, doc);
  }
  std::vector<FieldDoc> rows;

 private:
  template <typename T, typename Limit>
  void add(std::string_view name, T& value, const Limit& limit, std::string_view doc);
  template <typename T, typename Limit>
  void add_value(const std::string& key, T& value, const Limit& limit, std::string_view doc);
  template <typename T>
  void add_section(const std::string& key, T& section, std::string_view doc);

  std::string path_;
};

std::string to_flow_yaml(const Node& node);
/// A number for readers: of many digits only four.
std::string format_briefly(double value);

template <typename T>
std::string type_name() {
  if constexpr (std::is_same_v<T, bool>)
    return "bool";
  else if constexpr (std::is_same_v<T, int>)
    return "int";
  else if constexpr (std::is_same_v<T, double>)
    return "number";
  else if constexpr (std::is_same_v<T, std::string>)
    return "string";
  else if constexpr (std::is_enum_v<T>)
    return "enum";
  else if constexpr (std::is_same_v<T, Node>)
    return "map";
  else if constexpr (is_optional<T>)
    return type_name<typename T::value_type>() + " or null";
  else if constexpr (is_vector<T> || is_array<T>)
    return "list of " + type_name<typename T::value_type>();
  else
    return "section";
}

inline std::string format_limit(NoLimit) {
  return "";
}
template <typename R>
std::string format_limit(const Range<R>& range) {
  // Appended piecewise: GCC 12 gives a false -Wrestrict warning for operator+ here.
  std::string text = "[";
  return text.append(format_number(range.low))
      .append(", ")
      .append(format_number(range.high))
      .append("]");
}
template <typename E>
std::string format_limit(const Choices<E>& choices) {
  std::string text;
  for (const auto& [name, choice] : choices) {
    text += (text.empty() ? "" : " \\| ") + std::string(name);
  }
  return text;
}

template <typename T>
void Documenter::add_section(const std::string& key, T& section, std::string_view doc) {
  rows.push_back({key, "section", "", "", std::string(doc)});
  Documenter inner(key);
  section.visit(inner);
  rows.insert(rows.end(), inner.rows.begin(), inner.rows.end());
}

template <typename T, typename Limit>
void Documenter::add_value(const std::string& key, T& value, const Limit& limit,
                           std::string_view doc) {
  std::string text;
  if constexpr (std::is_same_v<T, double>) {
    text = format_briefly(value);
  } else {
    text = to_flow_yaml(value_to_node(value, limit));
  }
  rows.push_back({key, type_name<T>(), std::move(text), format_limit(limit), std::string(doc)});
}

template <typename T, typename Limit>
void Documenter::add(std::string_view name, T& value, const Limit& limit, std::string_view doc) {
  const std::string key = join(path_, name);
  if constexpr (is_visitable<T>) {
    add_section(key, value, doc);
  } else if constexpr (is_optional<T>) {
    if constexpr (is_visitable<typename T::value_type>) {
      typename T::value_type section{};
      add_section(key, section, doc);
    } else {
      add_value(key, value, limit, doc);
    }
  } else {
    add_value(key, value, limit, doc);
  }
}

}  // namespace internal

/// Fills `value` from a node; absent keys keep their current values. Throws InputError with
/// file and line for unknown keys, wrong types and values out of range.
template <typename T>
void read(const Node& node, T& value, const std::string& path = "") {
  internal::read_struct(node, path, value);
}

/// All values of the struct, defaults included.
template <typename T>
Node to_node(const T& value) {
  return internal::value_to_node(value, internal::NoLimit{});
}

/// Every key of the struct with its default.
template <typename T>
std::vector<FieldDoc> document(const T& defaults, const std::string& path = "") {
  internal::Documenter documenter(path);
  T copy = defaults;
  copy.visit(documenter);
  return documenter.rows;
}

/// The documentation as a Markdown table.
std::string to_markdown(const std::vector<FieldDoc>& rows);

}  // namespace apvi::config
