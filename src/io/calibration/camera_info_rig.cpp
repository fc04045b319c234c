// SPDX-License-Identifier: BSD-3-Clause
#include "io/calibration/camera_info_rig.hpp"

#include <fmt/format.h>

#include <cctype>
#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "core/text.hpp"
#include "io/calibration/assumptions.hpp"
#include "io/calibration/entry.hpp"
#include "io/calibration/lens.hpp"

namespace apvi::io {
namespace {

using config::Node;

bool has_word(const std::string& name, std::string_view word) {
  const auto is_part = [&](std::size_t at) {
    return at < name.size() && std::isalnum(static_cast<unsigned char>(name[at])) != 0;
  };
  for (std::size_t at = name.find(word); at != std::string::npos; at = name.find(word, at + 1)) {
    if ((at == 0 || !is_part(at - 1)) && !is_part(at + word.size())) return true;
  }
  return false;
}

std::string camera_of(const Node& file) {
  std::string name = std::filesystem::path(file.source ? *file.source : "").stem().string();
  if (const auto given = find_entry(file, "", "camera_name")) name += " " + word_of(*given);
  name = text::to_lower(name);
  return has_word(name, "right") || has_word(name, "cam1") ? "cam1" : "cam0";
}

Node intrinsics_of(const Node& file) {
  const Entry matrix = require_entry(file, "", "camera_matrix", "{rows: 3, cols: 3, data}");
  const std::vector<double> k = numbers_of(matrix, 9, "a 3x3 matrix");
  if (k[1] != 0.0)
    fail_at(*matrix.node, matrix.key, "expected no skew: the second number must be 0");
  return numbers_at({k[0], k[4], k[2], k[5]}, *matrix.node);
}

// camera_calibration wrote `camera_model` for some years. Without either key, ROS reads plumb_bob.
void set_camera_info_lens(const Node& file, Node& camera) {
  const Entry k = require_entry(file, "", "distortion_coefficients", "{rows, cols, data}");
  const Node plumb_bob = word_at("plumb_bob", file);
  const Node none = word_at("none", file);
  auto model = find_entry(file, "", "distortion_model");
  if (!model) model = find_entry(file, "", "camera_model");
  if (numbers_of(k).empty()) model = Entry{&none, "distortion_model"};
  if (!model) {
    log_once(log::Level::warning,
             fmt::format("{}: distortion_model: missing; plumb_bob is assumed", file.where()));
    model = Entry{&plumb_bob, "distortion_model"};
  }
  set_lens(*model, k, camera);
}

}  // namespace

bool is_camera_info(const Node& file) {
  return file.find("camera_matrix") != nullptr &&
         (file.find("image_width") != nullptr || file.find("distortion_coefficients") != nullptr);
}

Node rig_of_camera_info(const Node& file) {
  Node camera = section_at(file);
  camera.member("intrinsics") = intrinsics_of(file);
  const Entry width = require_entry(file, "", "image_width", "pixels");
  const Entry height = require_entry(file, "", "image_height", "pixels");
  camera.member("resolution") = numbers_at({number_of(width), number_of(height)}, *width.node);
  set_camera_info_lens(file, camera);
  Node rig = section_at(file);
  rig.member(camera_of(file)) = camera;
  return rig;
}

}  // namespace apvi::io
