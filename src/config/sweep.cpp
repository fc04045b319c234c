// SPDX-License-Identifier: BSD-3-Clause
#include "config/sweep.hpp"

#include <algorithm>
#include <cctype>
#include <set>

#include "apvi/core/error.hpp"
#include "config/inherited_file.hpp"
#include "config/renamed_keys.hpp"
#include "core/text.hpp"

namespace apvi::config {
namespace {

namespace fs = std::filesystem;

constexpr std::size_t kMaxCases = 100'000;

struct Alternative {
  std::string label;
  std::string folder;  // part of a folder's name; empty: none
  Node keys;           // a map, its keys dotted or nested
};
struct Axis {
  std::string name;
  std::vector<Alternative> alternatives;
};

void set_key(Node& root, std::string_view path, const Node& value) {
  std::vector<std::string_view> words;
  text::split(path, '.', words);
  Node* node = &root;
  for (const std::string_view word : words) {
    if (word.empty()) fail_at(value, path, "empty key between dots");
    node = &node->member(word);
  }
  if (value.kind != Node::Kind::map) {
    *node = value;
    return;
  }
  for (const auto& [key, item] : value.members) set_key(*node, key, item);
}

void apply_keys(Node& root, const Node& keys, const std::string& where) {
  if (keys.is_null()) return;
  if (keys.kind != Node::Kind::map) fail_at(keys, where, "expected nested keys");
  for (const auto& [key, value] : keys.members) set_key(root, key, value);
}

// The keys nested, with old names replaced.
Node with_new_names(const Node& keys, const std::string& where, KeyRenamer& renamer) {
  Node nested;
  apply_keys(nested, keys, where);
  renamer.apply(nested);
  return nested;
}

// Short label of a value: the stem of a file, the items of a list joined by '+'.
std::string make_label(const Node& value) {
  if (value.kind == Node::Kind::list) {
    std::string label;
    for (const Node& item : value.items) {
      if (!label.empty()) label += '+';
      label += make_label(item);
    }
    return label;
  }
  if (value.is_null()) return "null";
  std::string text = value.text;
  if (text.find('/') == std::string::npos && !text.ends_with(".yaml")) return text;
  while (text.ends_with('/')) text.pop_back();
  return fs::path(text).stem().string();
}

std::string sanitize_folder_name(std::string name) {
  for (char& c : name) {
    const bool plain = std::isalnum(static_cast<unsigned char>(c)) != 0;
    if (!plain && std::string_view("+-._").find(c) == std::string_view::npos) c = '_';
  }
  if (name.starts_with('.')) name.front() = '_';
  return name == "cases" ? "_cases" : name;  // reserved for the sweep itself
}

// The last `count` parts of a path, or the text of another value.
std::string last_parts(const Node& value, int count) {
  if (value.kind != Node::Kind::scalar) return make_label(value);
  std::string text = value.text;
  while (text.ends_with('/')) text.pop_back();
  std::size_t begin = text.size();
  for (int i = 0; i < count && begin != std::string::npos && begin > 0; ++i) {
    begin = text.rfind('/', begin - 1);
  }
  return begin == std::string::npos ? text : text.substr(begin + 1);
}

bool has_double(const std::vector<Alternative>& alternatives, const std::string& label) {
  return std::count_if(alternatives.begin(), alternatives.end(),
                       [&](const Alternative& a) { return a.label == label; }) > 1;
}

// Recordings in folders of one name are told apart by the folders above, else by number.
void make_labels_unique(const Node& values, std::vector<Alternative>& alternatives) {
  constexpr int kMaxParts = 8;
  for (int parts = 1; parts <= kMaxParts; ++parts) {
    const std::vector<Alternative> before = alternatives;
    for (std::size_t i = 0; i < before.size(); ++i) {
      if (!has_double(before, before[i].label)) continue;
      alternatives[i].label = last_parts(values.items[i], parts);
    }
  }
  std::set<std::string> labels;
  for (Alternative& a : alternatives) {
    const std::string label = a.label;
    for (int n = 2; !labels.insert(a.label).second; ++n) a.label = fmt::format("{}_{}", label, n);
  }
}

Axis make_named_axis(const std::string& name, const Node& node) {
  Axis axis{name, {}};
  for (const auto& [label, keys] : node.members) {
    if (!keys.is_null() && keys.kind != Node::Kind::map) {
      fail_at(keys, fmt::format("{}.{}", name, label),
              "expected nested keys, such as {run.seed: 3}");
    }
    axis.alternatives.push_back({label, sanitize_folder_name(label), keys});
  }
  return axis;
}

Axis make_key_axis(const std::string& key, const Node& node) {
  Axis axis{key, {}};
  const std::string word = key.substr(key.rfind('.') + 1);
  for (const Node& value : node.items) {
    Alternative a{make_label(value), "", {}};
    a.folder = sanitize_folder_name(key == "base" ? a.label : word + "-" + a.label);
    a.keys.member(key) = value;
    axis.alternatives.push_back(std::move(a));
  }
  make_labels_unique(node, axis.alternatives);
  return axis;
}

Axis make_axis(const std::string& name, const Node& node) {
  Axis axis;
  if (node.kind == Node::Kind::map) axis = make_named_axis(name, node);
  if (node.kind == Node::Kind::list) axis = make_key_axis(name, node);
  if (axis.alternatives.empty()) {
    fail_at(node, name, "expected a list of values or named alternatives");
  }
  std::set<std::string> labels;
  for (Alternative& a : axis.alternatives) {
    if (!labels.insert(a.folder).second) a.folder += fmt::format("_{}", labels.size() + 1);
    labels.insert(a.folder);
  }
  return axis;
}

std::vector<Axis> make_axes(const SweepFile& file) {
  std::vector<Axis> axes;
  if (!file.cases.is_null()) {
    if (file.cases.kind != Node::Kind::map) {
      fail_at(file.cases, "cases", "expected named alternatives");
    }
    axes.push_back(make_axis("case", file.cases));
  }
  if (file.grid.is_null()) return axes;
  if (file.grid.kind != Node::Kind::map) fail_at(file.grid, "grid", "expected keys with lists");
  for (const auto& [name, node] : file.grid.members) axes.push_back(make_axis(name, node));
  return axes;
}

int read_non_negative_int(const Node& node) {
  int value = 0;
  internal::read_scalar(node, "seeds", value);
  internal::check_limit(node, "seeds", value, Range{0, 2147483647});
  return value;
}

std::vector<std::optional<int>> expand_seeds(const Node& seeds) {
  if (seeds.is_null()) return {std::nullopt};
  std::vector<std::optional<int>> list;
  if (seeds.kind == Node::Kind::list) {
    for (const Node& seed : seeds.items) list.emplace_back(read_non_negative_int(seed));
  } else {
    const int count = read_non_negative_int(seeds);
    if (count > static_cast<int>(kMaxCases)) fail_at(seeds, "seeds", "too many");
    for (int seed = 1; seed <= count; ++seed) list.emplace_back(seed);
  }
  if (list.empty()) fail_at(seeds, "seeds", "expected at least one");
  return list;
}

// Configuration files are found as those under `inherit` are.
Node absolute_paths(const Node& base, const fs::path& folder, const std::vector<fs::path>& search) {
  Node files;
  files.kind = Node::Kind::list;
  const std::vector<Node> names =
      base.kind == Node::Kind::list ? base.items : std::vector<Node>{base};
  for (const Node& name : names) {
    Node file = name;
    const fs::path found = inherited_file(name, "base", folder, search);
    file.text = fs::absolute(found).lexically_normal().string();
    files.items.push_back(std::move(file));
  }
  return files;
}

SweepCase make_case(const SweepFile& file, const std::vector<Axis>& axes,
                    const std::vector<std::size_t>& index, const fs::path& path,
                    const std::vector<fs::path>& search) {
  SweepCase result;
  Node keys;
  keys.kind = Node::Kind::map;
  if (!file.base.is_null()) keys.member("base") = file.base;
  apply_keys(keys, file.set, "set");
  for (std::size_t i = 0; i < axes.size(); ++i) {
    const Alternative& a = axes[i].alternatives[index[i]];
    apply_keys(keys, a.keys, axes[i].name);
    result.choices.emplace_back(axes[i].name, a.label);
    if (!a.folder.empty()) result.group += (result.group.empty() ? "" : "_") + a.folder;
  }
  if (result.group.empty()) result.group = sanitize_folder_name(path.stem().string());
  const Node* base = keys.find("base");
  if (base == nullptr) {
    fail_input("{}: base: missing; set it to the configuration file that the cases modify",
               path.string());
  }
  result.config.member("inherit") = absolute_paths(*base, path.parent_path(), search);
  std::erase_if(keys.members, [](const auto& member) { return member.first == "base"; });
  merge(result.config, keys);
  return result;
}

// Advances to the next combination, the last axis varying fastest; false after the last one.
bool advance(std::vector<std::size_t>& index, const std::vector<Axis>& axes) {
  for (std::size_t i = axes.size(); i-- > 0;) {
    if (++index[i] < axes[i].alternatives.size()) return true;
    index[i] = 0;
  }
  return false;
}

}  // namespace

fs::path SweepCase::folder() const {
  return seed ? fs::path(group) / fmt::format("seed-{}", *seed) : fs::path(group);
}

Sweep load_sweep(const fs::path& path, const std::vector<fs::path>& search) {
  Sweep sweep;
  read(load_with_inheritance(path, {}, search), sweep.file);
  SweepFile& file = sweep.file;
  const bool simulates = file.command == SweepFile::Command::sim;
  if (file.seed_key.empty()) file.seed_key = simulates ? "seed" : "run.seed";
  std::vector<Axis> axes = make_axes(file);
  KeyRenamer renamer(simulates ? scene_renames() : run_renames());
  file.set = with_new_names(file.set, "set", renamer);
  for (Axis& axis : axes) {
    for (Alternative& a : axis.alternatives) a.keys = with_new_names(a.keys, axis.name, renamer);
    axis.name = renamer.renamed(axis.name);
  }
  const std::vector<std::optional<int>> seeds = expand_seeds(file.seeds);
  std::size_t count = seeds.size();
  for (const Axis& axis : axes) {
    count *= axis.alternatives.size();
    if (count > kMaxCases) fail_input("{}: more than {} cases", path.string(), kMaxCases);
  }
  std::vector<std::size_t> index(axes.size(), 0);
  std::set<std::string> groups;
  do {
    SweepCase one = make_case(file, axes, index, path, search);
    while (!groups.insert(one.group).second) one.group += "_2";
    for (const std::optional<int>& seed : seeds) {
      SweepCase& added = sweep.cases.emplace_back(one);
      added.seed = seed;
      if (!seed) continue;
      Node value;
      value.kind = Node::Kind::scalar;
      value.text = std::to_string(*seed);
      set_key(added.config, file.seed_key, value);
    }
  } while (advance(index, axes));
  return sweep;
}

}  // namespace apvi::config
