// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "apvi/config/node.hpp"
#include "apvi/geometry/se3.hpp"

/// Values of calibration files of other tools, with errors that name file, line and key.
namespace apvi::io {

/// A value with the name that the file gives it, such as "cam0.T_cam_imu".
struct Entry {
  const config::Node* node = nullptr;
  std::string key;
};

/// The member `name` of `parent`, whose own name is `path` ("" for a file); nullopt if it is
/// absent or null.
std::optional<Entry> find_entry(const config::Node& parent, std::string_view path,
                                std::string_view name);
/// As above. Throws InputError when there is none; `expected` completes the message.
Entry require_entry(const config::Node& parent, std::string_view path, std::string_view name,
                    std::string_view expected);

/// A finite number. Throws InputError for anything else.
double number_of(const Entry& entry);
/// The text of a scalar. Throws InputError for anything else.
const std::string& word_of(const Entry& entry);
/// Finite numbers of a list, of a list of rows, or of OpenCV's {rows, cols, data}. Throws
/// InputError for anything else.
std::vector<double> numbers_of(const Entry& entry);
/// As above, with a fixed count. `names` says in messages what the numbers are.
std::vector<double> numbers_of(const Entry& entry, std::size_t count, std::string_view names);
/// A rigid transform of 16 numbers, row by row, or of 12 without the last row. Throws InputError
/// for anything else.
SE3 pose_of(const Entry& entry);

/// Nodes for rig.yaml that keep the place of `place` for later messages.
config::Node section_at(const config::Node& place);
config::Node word_at(std::string_view word, const config::Node& place);
config::Node number_at(double number, const config::Node& place);
config::Node numbers_at(const std::vector<double>& numbers, const config::Node& place);
config::Node pose_at(const SE3& pose, const config::Node& place);

/// A key of another tool and the key of rig.yaml with the same meaning and unit.
struct RenamedKey {
  std::string_view theirs;
  std::string_view ours;
};
/// Copies the numbers that `from` has to `section`. Throws InputError for what is not a number.
void copy_numbers(const config::Node& from, std::string_view path,
                  const std::vector<RenamedKey>& keys, config::Node& section);
/// Copies a list of `count` numbers, if `from` has it. Throws InputError for anything else.
void copy_list(const config::Node& from, std::string_view path, std::string_view key,
               std::size_t count, std::string_view names, config::Node& section);

}  // namespace apvi::io
