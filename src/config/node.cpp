// SPDX-License-Identifier: BSD-3-Clause
#include "apvi/config/node.hpp"

#include <yaml-cpp/eventhandler.h>
#include <yaml-cpp/yaml.h>

#include <algorithm>
#include <fstream>
#include <optional>
#include <sstream>

#include "apvi/core/error.hpp"
#include "config/inherited_file.hpp"
#include "core/text.hpp"

namespace apvi::config {
namespace {

namespace fs = std::filesystem;
using Source = std::shared_ptr<const std::string>;

// Limits that protect the stack from deep nesting, and memory from nested aliases.
constexpr int kMaxDepth = 64;
constexpr int kMaxNodes = 100'000;

// Source of the nodes, and their number so far.
struct ParseContext {
  Source source;
  int count = 0;
};

Node convert(const YAML::Node& yaml, ParseContext& context, int depth);

void convert_map(const YAML::Node& yaml, ParseContext& context, int depth, Node& node) {
  node.kind = Node::Kind::map;
  for (const auto& entry : yaml) {
    if (!entry.first.IsScalar()) fail_at(node, "", "a key must be a scalar");
    const std::string key = entry.first.Scalar();
    if (node.find(key) != nullptr) {
      Node here;
      here.source = context.source;
      here.line = entry.first.Mark().line + 1;
      fail_at(here, key, "duplicate key; delete one of them");
    }
    Node value = convert(entry.second, context, depth + 1);
    if (value.is_null()) value.line = entry.first.Mark().line + 1;
    node.members.emplace_back(key, std::move(value));
  }
}

Node convert(const YAML::Node& yaml, ParseContext& context, int depth) {
  Node node;
  node.source = context.source;
  node.line = yaml.Mark().line + 1;
  if (++context.count > kMaxNodes) fail_at(node, "", "too large to be a configuration");
  if (depth > kMaxDepth) fail_at(node, "", "nested too deeply to be a configuration");
  switch (yaml.Type()) {
    case YAML::NodeType::Scalar:
      node.kind = Node::Kind::scalar;
      node.text = yaml.Scalar();
      break;
    case YAML::NodeType::Sequence:
      node.kind = Node::Kind::list;
      for (const YAML::Node& item : yaml) node.items.push_back(convert(item, context, depth + 1));
      break;
    case YAML::NodeType::Map:
      convert_map(yaml, context, depth, node);
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

struct Loading {
  const std::function<void(Node&)>& edit;
  const std::vector<fs::path>& search;
  std::vector<fs::path> open_files = {};
};

Node load_inherited(const fs::path& path, Loading& loading) {
  std::vector<fs::path>& open_files = loading.open_files;
  const fs::path canonical = fs::weakly_canonical(path);
  if (std::find(open_files.begin(), open_files.end(), canonical) != open_files.end()) {
    fail_input("{}: inherit: this file inherits from itself; remove the cycle", path.string());
  }
  Node own = load_file(path);
  std::vector<Node> parents;
  if (const Node* inherit = own.find("inherit")) {
    parents = inherit->kind == Node::Kind::list ? inherit->items : std::vector<Node>{*inherit};
    std::erase_if(own.members, [](const auto& member) { return member.first == "inherit"; });
  }
  if (loading.edit) loading.edit(own);
  if (parents.empty()) return own;
  open_files.push_back(canonical);
  Node merged;
  for (const Node& parent : parents) {
    const fs::path file = inherited_file(parent, "inherit", path.parent_path(), loading.search);
    merge(merged, load_inherited(file, loading));
  }
  open_files.pop_back();
  merge(merged, own);
  return merged;
}

// Records the line where a document starts and that of its first content, from 1; 0: none.
class FirstContentHandler : public YAML::EventHandler {
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

// YAML::Load ignores further documents; YAML::LoadAll does not terminate for some broken files.
std::optional<int> find_second_document(const std::string& text) {
  std::istringstream in(text);
  YAML::Parser parser(in);
  FirstContentHandler first;
  FirstContentHandler second;
  FirstContentHandler third;
  if (!parser.HandleNextDocument(first) || !parser.HandleNextDocument(second)) return std::nullopt;
  if (second.line() > 0) return second.line();
  // After a syntax error the parser reports an endless series of empty documents.
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

Node parse_yaml(const std::string& given, const std::string& source) {
  ParseContext context{std::make_shared<const std::string>(source)};
  std::string text = given;
  if (text.starts_with("\xEF\xBB\xBF")) text.erase(0, 3);  // byte order mark
  // OpenCV writes an invalid directive; turned into a comment, it does not shift line numbers.
  if (text.starts_with("%YAML:")) text[0] = '#';
  try {
    if (const auto line = find_second_document(text)) {
      fail_input("{}:{}: second YAML document; move it to a separate file", source, *line);
    }
    return convert(YAML::Load(text), context, 0);
  } catch (const YAML::Exception& e) {
    fail_input("{}:{}: not valid YAML: {}", source, e.mark.line + 1, e.msg);
  }
}

Node load_file(const fs::path& path) {
  if (fs::is_directory(path)) fail_input("{}: this is a folder, not a file", path.string());
  std::ifstream in(path, std::ios::binary);
  if (!in) fail_input("{}: cannot open; check the path", path.string());
  std::ostringstream text;
  text << in.rdbuf();
  return parse_yaml(text.str(), path.string());
}

Node load_with_inheritance(const fs::path& path) {
  return load_with_inheritance(path, {});
}

Node load_with_inheritance(const fs::path& path, const std::function<void(Node&)>& edit,
                           const std::vector<fs::path>& search) {
  Loading loading{.edit = edit, .search = search};
  return load_inherited(path, loading);
}

void merge(Node& base, const Node& over) {
  if (base.kind != Node::Kind::map || over.kind != Node::Kind::map) {
    base = over;
    return;
  }
  for (const auto& [key, value] : over.members) merge(base.member(key), value);
}

namespace {

// Lists, maps and quoted text are YAML. "[a]/b" is neither.
bool is_structured(std::string_view value) {
  const char first = value.empty() ? ' ' : value.front();
  if (first == '"' || first == '\'') return value.size() > 1 && value.back() == first;
  if (first != '[' && first != '{') return false;
  const std::size_t closing = value.find_last_of("]}");
  return closing == std::string_view::npos || closing + 1 == value.size();
}

// Anything else is literal: '#' and ": " in the name of a folder are not YAML.
Node parse_value(std::string_view value, const std::string& source) {
  value = text::trim(value);
  if (is_structured(value)) return parse_yaml(std::string(value), source);
  Node node;
  node.source = std::make_shared<const std::string>(source);
  const std::string word = text::to_lower(value);
  if (word.empty() || word == "null" || word == "~") return node;
  node.kind = Node::Kind::scalar;
  node.text = std::string(value);
  return node;
}

}  // namespace

Override parse_override(std::string_view assignment) {
  const std::size_t equals = assignment.find('=');
  const std::string_view key = text::trim(assignment.substr(0, equals));
  if (equals == std::string_view::npos || key.empty()) {
    fail_input("--set {}: expected key=value, for example run.seed=3", assignment);
  }
  Node value = parse_value(assignment.substr(equals + 1), fmt::format("--set {}", key));
  // Messages about a value name its key, so its source need not.
  const auto source = std::make_shared<const std::string>("--set");
  const auto strip_lines = [&source](const auto& self, Node& node) -> void {
    node.line = 0;
    node.source = source;
    for (Node& item : node.items) self(self, item);
    for (auto& [name, item] : node.members) self(self, item);
  };
  strip_lines(strip_lines, value);
  return {std::string(key), std::move(value)};
}

void set_value(Node& root, std::string_view key, Node value) {
  std::vector<std::string_view> parts;
  text::split(key, '.', parts);
  Node* node = &root;
  for (const std::string_view part : parts) {
    if (part.empty()) fail_at(value, key, "empty key between dots");
    node = &node->member(part);
    if (!node->source) node->source = value.source;
  }
  *node = std::move(value);
}

void apply_override(Node& root, std::string_view assignment) {
  Override parsed = parse_override(assignment);
  set_value(root, parsed.key, std::move(parsed.value));
}

std::string to_yaml(const Node& node) {
  YAML::Emitter out;
  emit(out, node);
  return std::string(out.c_str()) + "\n";
}

}  // namespace apvi::config
