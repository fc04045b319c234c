// SPDX-License-Identifier: BSD-3-Clause
#include <Eigen/LU>
#include <cctype>
#include <cmath>

#include "core/text.hpp"
#include "importer/telemetry.hpp"

namespace apvi::importer {
namespace {

// Camera axes (x right, y down, z forward) of GoPro's X (left), Y (backward), Z (up).
Eigen::Matrix3d camera_of_gopro() {
  Eigen::Matrix3d m;
  m << -1, 0, 0, /**/ 0, 0, -1, /**/ 0, -1, 0;
  return m;
}

// Rotation from channels to X, Y, Z by their letters.
std::optional<Eigen::Matrix3d> rotation_of_letters(const std::string& letters) {
  if (letters.size() != 3) return std::nullopt;
  Eigen::Matrix3d m = Eigen::Matrix3d::Zero();
  for (int channel = 0; channel < 3; ++channel) {
    const char letter = letters[static_cast<std::size_t>(channel)];
    const bool negative = std::islower(static_cast<unsigned char>(letter)) != 0;
    const int axis = std::toupper(static_cast<unsigned char>(letter)) - 'X';
    if (axis < 0 || axis > 2) return std::nullopt;
    m(axis, channel) = negative ? -1.0 : 1.0;
  }
  if (std::abs(m.determinant()) < 0.5) return std::nullopt;  // a letter twice
  return m;
}

// Order of the channels of cameras that do not report it.
std::string letters_of_device(const std::string& device) {
  const std::string name = text::to_lower(device);
  const auto is = [&name](const char* model) { return name.find(model) != name.npos; };
  if (is("fusion")) return "yXZ";
  return is("hero6") || is("hero7") ? "YxZ" : "ZXY";
}

std::optional<Eigen::Matrix3d> proper(const std::optional<Eigen::Matrix3d>& R) {
  if (!R || !((*R * R->transpose() - Eigen::Matrix3d::Identity()).norm() < 1e-3)) return {};
  return R->determinant() > 0.0 ? R : std::nullopt;
}

std::optional<Eigen::Matrix3d> rotation_of_matrix(const GpmfStream& stream) {
  const auto out = rotation_of_letters(stream.orientation_out);
  if (!out || stream.matrix.size() != 9) return std::nullopt;
  const Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>> m(stream.matrix.data());
  return proper(*out * m);
}

}  // namespace

std::optional<Eigen::Matrix3d> rotation_to_camera(const GpmfStream& stream,
                                                  const std::string& device) {
  const std::string in =
      stream.orientation_in.empty() ? letters_of_device(device) : stream.orientation_in;
  const auto by_channels = proper(rotation_of_letters(in));
  const auto by_matrix = rotation_of_matrix(stream);
  const bool contradict = by_channels && by_matrix && (*by_channels - *by_matrix).norm() > 0.5;
  const auto R = by_matrix && !contradict ? by_matrix : by_channels;
  if (!R) return std::nullopt;
  return camera_of_gopro() * *R;
}

}  // namespace apvi::importer
