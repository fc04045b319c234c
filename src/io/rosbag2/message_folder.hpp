// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>
#include <map>
#include <string>
#include <vector>

namespace apvi::io {

/// Definitions of message types from .msg files, for bags that do not contain them.
class MessageFolder {
 public:
  /// No files: only the types of `ros2_definitions` are known.
  MessageFolder() = default;
  /// Reads PACKAGE/msg/NAME.msg and PACKAGE/NAME.msg at any depth below the folder. Throws
  /// InputError when there are none.
  explicit MessageFolder(const std::filesystem::path& folder);

  /// As `ros2_definitions`; the files take precedence.
  std::vector<std::string> definitions(const std::string& type) const;

 private:
  std::map<std::string, std::string> texts_;  // by type, such as "dvl_msgs/DVL"
};

}  // namespace apvi::io
