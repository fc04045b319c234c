// SPDX-License-Identifier: BSD-3-Clause
#include <array>
#include <cmath>

#include "apvi/core/error.hpp"
#include "importer/colmap_model.hpp"
#include "importer/colmap_numbers.hpp"

namespace apvi::importer {
namespace {

struct ModelId {
  const char* name;
  std::size_t parameters;
};

// In the order of their numbers.
constexpr std::array<ModelId, 12> kModels = {{{"SIMPLE_PINHOLE", 3},
                                              {"PINHOLE", 4},
                                              {"SIMPLE_RADIAL", 4},
                                              {"RADIAL", 5},
                                              {"OPENCV", 8},
                                              {"OPENCV_FISHEYE", 8},
                                              {"FULL_OPENCV", 12},
                                              {"FOV", 5},
                                              {"SIMPLE_RADIAL_FISHEYE", 4},
                                              {"RADIAL_FISHEYE", 5},
                                              {"THIN_PRISM_FISHEYE", 12},
                                              {"RAD_TAN_THIN_PRISM_FISHEYE", 16}}};

void check(const ByteReader& in, const std::string& name) {
  if (!in.ok()) fail_input("{}: ends early; copy the file again", name);
}

void skip_items(ByteReader& in, std::uint64_t count, std::size_t size, const std::string& name) {
  if (count > in.left() / size) fail_input("{}: ends early; copy the file again", name);
  in.skip(static_cast<std::size_t>(count) * size);
}

std::string terminated(ByteReader& in) {
  std::string text;
  for (std::uint8_t c = in.u8(); c != 0 && in.ok(); c = in.u8()) {
    text += static_cast<char>(c);
  }
  return text;
}

}  // namespace

std::map<std::uint32_t, ColmapCamera> parse_cameras_bin(Bytes file, const std::string& name) {
  std::map<std::uint32_t, ColmapCamera> cameras;
  ByteReader in(file, ByteOrder::little);
  for (std::uint64_t left = in.u64(); left > 0; --left) {
    const std::uint32_t id = in.u32();
    const std::uint32_t model = in.u32();
    ColmapCamera camera{.model = {}, .width = in.u64(), .height = in.u64(), .parameters = {}};
    check(in, name);
    if (model >= kModels.size()) {
      fail_input("{}: camera {}: unknown camera model {}", name, id, model);
    }
    camera.model = kModels[model].name;
    for (std::size_t i = 0; i < kModels[model].parameters; ++i) {
      camera.parameters.push_back(in.f64());
    }
    check(in, name);
    cameras[id] = camera;
  }
  check(in, name);
  return cameras;
}

std::vector<ColmapImage> parse_images_bin(Bytes file, const std::string& name) {
  constexpr std::size_t kObservationBytes = 24;
  std::vector<ColmapImage> images;
  ByteReader in(file, ByteOrder::little);
  for (std::uint64_t left = in.u64(); left > 0; --left) {
    const std::uint32_t id = in.u32();
    std::array<double, 7> pose{};
    for (double& number : pose) number = in.f64();
    ColmapImage image{.name = {}, .camera = in.u32(), .T_camera_world = {}};
    image.name = terminated(in);
    check(in, name);
    skip_items(in, in.u64(), kObservationBytes, name);
    image.T_camera_world = to_pose(pose, fmt::format("{}: image {}", name, id));
    images.push_back(std::move(image));
  }
  check(in, name);
  return images;
}

std::vector<ColmapPoint> parse_points_bin(Bytes file, const std::string& name) {
  constexpr std::size_t kTrackBytes = 8;
  std::vector<ColmapPoint> points;
  ByteReader in(file, ByteOrder::little);
  for (std::uint64_t left = in.u64(); left > 0; --left) {
    in.skip(8);  // id
    ColmapPoint point;
    for (int i = 0; i < 3; ++i) point.position[i] = in.f64();
    for (int& channel : point.color) channel = in.u8();
    in.skip(8);  // error
    check(in, name);
    skip_items(in, in.u64(), kTrackBytes, name);
    if (point.position.allFinite()) points.push_back(point);
  }
  check(in, name);
  return points;
}

}  // namespace apvi::importer
