// SPDX-License-Identifier: BSD-3-Clause
#include <fmt/ranges.h>

#include <algorithm>
#include <array>
#include <map>
#include <utility>

#include "apvi/config/node.hpp"
#include "apvi/core/error.hpp"
#include "apvi/core/log.hpp"
#include "core/text.hpp"
#include "io/readers.hpp"
#include "io/rosbag2/block_cursor.hpp"

namespace apvi::io {
namespace {

namespace fs = std::filesystem;

std::shared_ptr<const BagFile> open_one(const fs::path& path, const MessageFolder& definitions) {
  const std::string extension = text::to_lower(path.extension().string());
  if (extension == ".mcap") return open_mcap(path);
  if (extension == ".db3") return open_sqlite(path, definitions);
  if (extension == ".zstd" || extension == ".zst") {
    fail_input(
        "{0}: compressed as a whole file, which cannot be read in parts; run \"zstd -d {0}\"",
        path.string());
  }
  fail_input("{}: not a file of a ROS 2 bag; expected .mcap or .db3", path.string());
}

bool is_bag_file(const fs::path& path) {
  const std::string extension = text::to_lower(path.extension().string());
  return extension == ".mcap" || extension == ".db3";
}

const config::Node* member(const config::Node* node, std::string_view key) {
  return node == nullptr ? nullptr : node->find(key);
}

// The listed file, or what the user has decompressed it to.
fs::path existing(const fs::path& listed) {
  const std::string extension = listed.extension().string();
  fs::path decompressed = fs::path(listed).replace_extension();
  if ((extension == ".zstd" || extension == ".zst") && fs::exists(decompressed)) {
    return decompressed;
  }
  if (fs::exists(listed)) return listed;
  fail_input("{}: no such file, but metadata.yaml lists it", listed.string());
}

// The files that metadata.yaml lists, or all of the folder: `ros2 bag reindex` needs no metadata
// either, and an interrupted recording has none.
std::vector<fs::path> files_of(const fs::path& folder) {
  std::vector<fs::path> files;
  if (fs::exists(folder / "metadata.yaml")) {
    const config::Node metadata = config::load_file(folder / "metadata.yaml");
    const auto* list = member(metadata.find("rosbag2_bagfile_information"), "relative_file_paths");
    if (list != nullptr) {
      for (const config::Node& item : list->items) files.push_back(existing(folder / item.text));
    }
  }
  if (files.empty()) {
    for (const auto& entry : fs::directory_iterator(folder)) {
      if (is_bag_file(entry.path())) files.push_back(entry.path());
    }
    std::sort(files.begin(), files.end());
  }
  if (files.empty()) fail_input("{}: no .mcap or .db3 file in this folder", folder.string());
  return files;
}

struct Topics {
  std::vector<BagTopic> readable;
  std::map<std::string, std::string> unreadable;  // why, by name
};

Topics topics_of(const BagFiles& files) {
  Topics topics;
  std::map<std::string, BagTopic> readable;
  for (const auto& file : files) {
    for (const BagStream& stream : file->streams()) {
      if (stream.problem.empty()) {
        readable[stream.topic] = {stream.topic, stream.type, stream.definitions.front()};
      } else {
        topics.unreadable[stream.topic] = stream.problem;
      }
    }
  }
  for (auto& [name, topic] : readable) {
    topics.unreadable.erase(name);
    topics.readable.push_back(std::move(topic));
  }
  return topics;
}

constexpr const char* kRemedy =
    "readable are ROS messages (cdr) with a definition (ros2msg); dataset.message_definitions adds "
    "definitions from .msg files";

std::string list_of(const std::map<std::string, std::string>& unreadable) {
  std::vector<std::string> lines;
  for (const auto& [name, why] : unreadable) lines.push_back(fmt::format("{} ({})", name, why));
  return fmt::format("{}", fmt::join(lines, ", "));
}

void check_configured(const Topics& topics, const TopicConfig& config, const std::string& path) {
  for (const std::string* name : {&config.imu, &config.dvl, &config.pressure, &config.depth,
                                  &config.cam0, &config.cam1, &config.reference}) {
    const auto it = topics.unreadable.find(*name);
    if (it == topics.unreadable.end()) continue;
    fail_input("{}: cannot read topic {}: {}; {}", path, it->first, it->second, kRemedy);
  }
}

void check_topics(const Topics& topics, const TopicConfig& config, const std::string& path) {
  check_configured(topics, config, path);
  if (topics.readable.empty()) {
    if (topics.unreadable.empty()) fail_input("{}: no topics in this ROS 2 bag", path);
    fail_input("{}: no readable topics: {}; {}", path, list_of(topics.unreadable), kRemedy);
  }
  if (!topics.unreadable.empty()) {
    log::info("{}: unreadable topics: {}", path, list_of(topics.unreadable));
  }
}

}  // namespace

Recording open_rosbag2(const fs::path& path, const DatasetConfig& config,
                       const SensorChoice& choice) {
  const bool folder = fs::is_directory(path);
  const MessageFolder definitions = config.message_definitions.empty()
                                        ? MessageFolder()
                                        : MessageFolder(config.message_definitions);
  BagFiles files;
  for (const fs::path& file : folder ? files_of(path) : std::vector{path}) {
    files.push_back(open_one(file, definitions));
  }
  Topics topics = topics_of(files);
  check_topics(topics, config.topics, path.string());
  const std::string name = path.string();
  const auto open = [name, files](const std::set<std::string>& wanted) {
    return make_block_cursor(name, files, wanted);
  };
  const fs::path rig = (folder ? path : path.parent_path()) / "rig.yaml";
  return read_bag({name, std::move(topics.readable), open}, rig, config, choice);
}

}  // namespace apvi::io
