// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <filesystem>
#include <map>
#include <string>
#include <vector>

#include "apvi/geometry/se3.hpp"
#include "apvi/sensors/camera_model.hpp"
#include "importer/byte_reader.hpp"

/// COLMAP's sparse models, text and binary.
namespace apvi::importer {

struct ColmapCamera {
  std::string model;  ///< "SIMPLE_RADIAL"
  std::uint64_t width = 0;
  std::uint64_t height = 0;
  std::vector<double> parameters;
};

struct ColmapImage {
  std::string name;  ///< below the folder of images
  std::uint32_t camera = 0;
  SE3 T_camera_world;
};

struct ColmapPoint {
  Eigen::Vector3d position;
  std::array<int, 3> color{};  ///< red, green, blue
};

struct ColmapModel {
  std::map<std::uint32_t, ColmapCamera> cameras;
  std::vector<ColmapImage> images;
  std::vector<ColmapPoint> points;
};

/// Parsers of one file. `name` is for messages. Throw InputError for a damaged file; those of text
/// name the line.
std::map<std::uint32_t, ColmapCamera> parse_cameras_txt(std::istream& in, const std::string& name);
std::vector<ColmapImage> parse_images_txt(std::istream& in, const std::string& name);
std::vector<ColmapPoint> parse_points_txt(std::istream& in, const std::string& name);
std::map<std::uint32_t, ColmapCamera> parse_cameras_bin(Bytes file, const std::string& name);
std::vector<ColmapImage> parse_images_bin(Bytes file, const std::string& name);
std::vector<ColmapPoint> parse_points_bin(Bytes file, const std::string& name);

/// Reads cameras, images and, if there are any, points3D of a folder, .bin before .txt.
ColmapModel read_colmap_model(const std::filesystem::path& folder);

/// The camera in this project's convention, in which the center of the first pixel is (0, 0), not
/// (0.5, 0.5). Throws InputError for a model whose distortion cannot be expressed.
CameraModel::Parameters to_camera(const ColmapCamera& camera, const std::string& name);

}  // namespace apvi::importer
