// SPDX-License-Identifier: BSD-3-Clause
#include "io/folder/euroc_rig.hpp"

#include <fmt/format.h>

#include <Eigen/Core>
#include <Eigen/LU>
#include <array>
#include <string_view>
#include <utility>
#include <vector>

#include "apvi/core/error.hpp"
#include "core/text.hpp"

namespace apvi::io {
namespace {

using config::Node;
using Renamed = std::pair<std::string_view, std::string_view>;  // EuRoC key, rig.yaml key
using Matrix4 = Eigen::Matrix<double, 4, 4, Eigen::RowMajor>;

const std::vector<Renamed>& known_keys(std::string_view sensor) {
  static const std::vector<Renamed> imu = {{"rate_hz", "rate_hz"},
                                           {"gyroscope_noise_density", "gyro_noise_density"},
                                           {"gyroscope_random_walk", "gyro_random_walk"},
                                           {"accelerometer_noise_density", "accel_noise_density"},
                                           {"accelerometer_random_walk", "accel_random_walk"}};
  static const std::vector<Renamed> camera = {{"rate_hz", "rate_hz"},
                                              {"camera_model", "model"},
                                              {"intrinsics", "intrinsics"},
                                              {"distortion_model", "distortion"},
                                              {"distortion_coefficients", "coefficients"},
                                              {"resolution", "resolution"}};
  static const std::vector<Renamed> other;
  if (sensor.starts_with("imu")) return imu;
  return sensor.starts_with("cam") ? camera : other;
}

// The 16 numbers of T_BS: {rows, cols, data} or a plain list; null when there is none.
const Node* pose_numbers(const Node& sensor) {
  const Node* pose = sensor.find("T_BS");
  if (pose == nullptr || pose->is_null()) return nullptr;
  const Node* data = pose->kind == Node::Kind::map ? pose->find("data") : pose;
  if (data == nullptr || data->kind != Node::Kind::list || data->items.size() != 16) {
    fail_at(*pose, "T_BS", "expected 16 numbers, row-major, under data");
  }
  return data;
}

Matrix4 to_matrix(const Node& numbers) {
  Matrix4 matrix;
  for (std::size_t i = 0; i < 16; ++i) {
    const auto number = text::parse_double(numbers.items[i].text);
    if (!number) fail_at(numbers.items[i], "T_BS", "expected a number");
    matrix(static_cast<Eigen::Index>(i / 4), static_cast<Eigen::Index>(i % 4)) = *number;
  }
  return matrix;
}

// Keeps the source location of the numbers for later error messages.
Node to_node(const Matrix4& matrix, Node numbers) {
  for (std::size_t i = 0; i < 16; ++i) {
    numbers.items[i].text = fmt::format(
        "{:.17g}", matrix(static_cast<Eigen::Index>(i / 4), static_cast<Eigen::Index>(i % 4)));
  }
  return numbers;
}

Node section_of(std::string_view name, const Node& sensor) {
  Node section;
  section.kind = Node::Kind::map;
  section.source = sensor.source;
  section.line = sensor.line;
  for (const auto& [theirs, ours] : known_keys(name)) {
    if (const Node* value = sensor.find(theirs)) section.member(ours) = *value;
  }
  Node* distortion = section.find("distortion") ? &section.member("distortion") : nullptr;
  if (distortion != nullptr && distortion->text == "radial-tangential") distortion->text = "radtan";
  return section;
}

}  // namespace

Node parse_sensor_yaml(std::string text, const std::string& source) {
  // OpenCV writes an invalid directive; turned into a comment, it does not shift line numbers.
  if (text.starts_with("%YAML:")) text[0] = '#';
  Node node = config::parse_yaml(text, source);
  if (node.kind != Node::Kind::map) {
    fail_input("{}: no calibration in this file: expected keys such as T_BS and rate_hz", source);
  }
  return node;
}

Node rig_of_sensor_yamls(const std::map<std::string, Node>& sensors) {
  Matrix4 T_imu_body = Matrix4::Identity();
  if (const auto imu = sensors.find("imu0"); imu != sensors.end()) {
    if (const Node* numbers = pose_numbers(imu->second)) {
      const Matrix4 T_body_imu = to_matrix(*numbers);
      if (!(std::abs(T_body_imu.determinant()) > 0.5)) {
        fail_at(*numbers, "T_BS", "this matrix is not a rigid transform");
      }
      T_imu_body = T_body_imu.inverse();
    }
  }
  Node rig;
  rig.kind = Node::Kind::map;
  for (const auto& [name, sensor] : sensors) {
    Node section = section_of(name, sensor);
    const Node* numbers = pose_numbers(sensor);
    if (name != "imu0" && numbers != nullptr) {
      section.member("T_body_sensor") = to_node(T_imu_body * to_matrix(*numbers), *numbers);
    }
    rig.member(name) = std::move(section);
  }
  return rig;
}

}  // namespace apvi::io
