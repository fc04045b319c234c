// SPDX-License-Identifier: BSD-3-Clause
#include "apvi/config/node.hpp"

#include <yaml-cpp/eventhandler.h>
#include <yaml-cpp/yaml.h>

#include <algorithm>
#include <fstream>
#include <optional>
#include <sstream>

#include "apvi/core/error.hpp"
#include "apvi/core/text.hpp"

namespace apvi::config {
namespace {

namespace fs = std::filesystem;
using Source = std::shared_ptr<const std::string>;

// No configuration is deeper or larger. A hostile file must not end the stack, nor must aliases of
// aliases fill the memory.
constexpr int kMaxDepth = 64;
constexpr int kMaxNodes = 100'000;

// Where nodes come from, and how many there have been.
struct Origin {
  Source source;
  int count = 0;
};

Node convert(const YAML::Node& yaml, Origin& origin, int depth);

void convert_map(const YAML::Node& yaml, Origin& origin, int depth, Node& node) {
  node.kind = Node::Kind::map;
  for (const auto& entry : yaml) {
    if (!entry.first.IsScalar()) fail_at(node, "", "a key must be a plain word");
    const std::string key = entry.first.Scalar();
    if (node.find(key) != nullptr) {
      Node here;
      here.source = origin.source;
      here.line = entry.first.Mark().line + 1;
      fail_at(here, key, "this key is given twice; delete one of them");
    }
    Node value = convert(entry.second, origin, depth + 1);
    if (value.is_null()) value.line = entry.first.Mark().line + 1;
    node.members.emplace_back(key, std::move(value));
  }
}

Node convert(const YAML::Node& yaml, Origin& origin, int depth) {
  Node node;
  node.source = origin.source;
  node.line = yaml.Mark().line + 1;
  if (++origin.count > kMaxNodes) fail_at(node, "", "too large to be a configuration");
  if (depth > kMaxDepth) fail_at(node, "", "nested too deeply to be a configuration");
  switch (yaml.Type()) {
    case YAML::NodeType::Scalar:
      node.kind = Node::Kind::scalar;
      node.text = yaml.Scalar();
      break;
    case YAML::NodeType::Sequence:
      node.kind = Node::Kind::list;
      for (const YAML::Node& item : yaml) node.items.push_back(convert(item, origin, depth + 1));
      break;
    case YAML::NodeType::Map:
      convert_map(yaml, origin, depth, node);
      break;
    case YAML::NodeType::Null:
    case YAML::NodeType::Undefined:
      break;
  }
  return node;
}

void emit(YAML::Emitter& out, const Node& node) {
  switch (node.kind) {
    case Node::Kind::null:
      out << YAML::Null;
      break;
    case Node::Kind::scalar:
      out << node.text;
      break;
    case Node::Kind::list:
      out << YAML::Flow << YAML::BeginSeq;
      for (const Node& item : node.items) emit(out, item);
      out << YAML::EndSeq;
      break;
    case Node::Kind::map:
      out << YAML::BeginMap;
      for (const auto& [key, value] : node.members) {
        out << YAML::Key << key << YAML::Value;
        emit(out, value);
      }
      out << YAML::EndMap;
      break;
  }
}

Node load_layers(const fs::path& path, std::vector<fs::path>& open_files) {
  const fs::path canonical = fs::weakly_canonical(path);
  if (std::find(open_files.begin(), open_files.end(), canonical) != open_files.end()) {
    fail_input("{}: inherit: this file inherits from itself; break the cycle", path.string());
  }
  Node own = load_file(path);
  const Node* inherit = own.find("inherit");
  if (inherit == nullptr) return own;
  std::vector<Node> parents =
      inherit->kind == Node::Kind::list ? inherit->items : std::vector<Node>{*inherit};
  open_files.push_back(canonical);
  Node merged;
  for (const Node& parent : parents) {
    if (parent.kind != Node::Kind::scalar) fail_at(parent, "inherit", "expected a file name");
    const fs::path parent_path = path.parent_path() / parent.text;
    if (!fs::exists(parent_path)) fail_at(parent, "inherit", "no such file: " + parent.text);
    merge(merged, load_layers(parent_path, open_files));
  }
  open_files.pop_back();
  std::erase_if(own.members, [](const auto& member) { return member.first == "inherit"; });
  merge(merged, own);
  return merged;
}

// Notes the lines where a document begins and where the first thing in it is, from 1; 0: nowhere.
class FirstContent : public YAML::EventHandler {
 public:
  void OnDocumentStart(const YAML::Mark& mark) override { start_ = mark.line + 1; }
  void OnDocumentEnd() override {}
  void OnNull(const YAML::Mark&, YAML::anchor_t) override {}
  void OnAlias(const YAML::Mark& mark, YAML::anchor_t) override { note(mark); }
  void OnScalar(const YAML::Mark& mark, const std::string&, YAML::anchor_t,
                const std::string&) override {
    note(mark);
  }
  void OnSequenceStart(const YAML::Mark& mark, const std::string&, YAML::anchor_t,
                       YAML::EmitterStyle::value) override {
    note(mark);
  }
  void OnSequenceEnd() override {}
  void OnMapStart(const YAML::Mark& mark, const std::string&, YAML::anchor_t,
                  YAML::EmitterStyle::value) override {
    note(mark);
  }
  void OnMapEnd() override {}

  int start() const { return start_; }
  int line() const { return line_; }

 private:
  void note(const YAML::Mark& mark) {
    if (line_ == 0) line_ = mark.line + 1;
  }
  int start_ = 0;
  int line_ = 0;
};

// Loading one document ignores what follows it, and loading all never ends for some broken files.
std::optional<int> line_of_second_document(const std::string& text) {
  std::istringstream in(text);
  YAML::Parser parser(in);
  FirstContent first;
  FirstContent second;
  FirstContent third;
  if (!parser.HandleNextDocument(first) || !parser.HandleNextDocument(second)) return std::nullopt;
  if (second.line() > 0) return second.line();
  // Where the parser cannot go on it sees one empty document after the other.
  return parser.HandleNextDocument(third) ? std::optional<int>(third.start()) : std::nullopt;
}

}  // namespace

Node::Node() = default;

const Node* Node::find(std::string_view key) const {
  const auto it = std::find_if(members.begin(), members.end(),
                               [&](const auto& member) { return member.first == key; });
  return it == members.end() ? nullptr : &it->second;
}

Node& Node::member(std::string_view key) {
  if (kind != Kind::map) {
    kind = Kind::map;
    text.clear();
    items.clear();
  }
  if (const Node* found = find(key)) return const_cast<Node&>(*found);
  members.emplace_back(std::string(key), Node{});
  return members.back().second;
}

std::string Node::where() const {
  if (!source) return "";
  return line > 0 ? fmt::format("{}:{}", *source, line) : *source;
}

void fail_at(const Node& node, std::string_view key, std::string_view what) {
  std::string message = node.where();
  for (const std::string_view part : {key, what}) {
    if (part.empty()) continue;
    if (!message.empty()) message += ": ";
    message += part;
  }
  throw InputError(message);
}

Node parse_yaml(const std::string& text, const std::string& source) {
  Origin origin{std::make_shared<const std::string>(source)};
  try {
    if (const auto line = line_of_second_document(text)) {
      fail_input("{}:{}: a second document begins here; put it into a file of its own", source,
                 *line);
    }
    return convert(YAML::Load(text), origin, 0);
  } catch (const YAML::Exception& e) {
    fail_input("{}:{}: not valid YAML: {}", source, e.mark.line + 1, e.msg);
  }
}

Node load_file(const fs::path& path) {
  if (fs::is_directory(path)) fail_input("{}: this is a folder, not a file", path.string());
  std::ifstream in(path, std::ios::binary);
  if (!in) fail_input("{}: cannot open; is the path right?", path.string());
  std::ostringstream text;
  text << in.rdbuf();
  return parse_yaml(text.str(), path.string());
}

Node load_with_inheritance(const fs::path& path) {
  std::vector<fs::path> open_files;
  return load_layers(path, open_files);
}

void merge(Node& base, const Node& over) {
  if (base.kind != Node::Kind::map || over.kind != Node::Kind::map) {
    base = over;
    return;
  }
  for (const auto& [key, value] : over.members) merge(base.member(key), value);
}

void apply_override(Node& root, std::string_view assignment) {
  const std::size_t equals = assignment.find('=');
  const std::string_view path = text::trim(assignment.substr(0, equals));
  if (equals == std::string_view::npos || path.empty()) {
    fail_input("--set {}: expected key=value, for example run.seed=3", assignment);
  }
  const std::string name = fmt::format("--set {}", path);
  Node value = parse_yaml(std::string(assignment.substr(equals + 1)), name);
  const auto strip_lines = [](const auto& self, Node& node) -> void {
    node.line = 0;
    for (Node& item : node.items) self(self, item);
    for (auto& [key, item] : node.members) self(self, item);
  };
  strip_lines(strip_lines, value);
  std::vector<std::string_view> keys;
  text::split(path, '.', keys);
  Node* node = &root;
  for (const std::string_view key : keys) {
    if (key.empty()) fail_input("{}: an empty word between dots", name);
    node = &node->member(key);
    if (!node->source) node->source = value.source;
  }
  *node = std::move(value);
}

std::string to_yaml(const Node& node) {
  YAML::Emitter out;
  emit(out, node);
  return std::string(out.c_str()) + "\n";
}

}  // namespace apvi::config
