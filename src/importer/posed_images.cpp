// SPDX-License-Identifier: BSD-3-Clause
#include "importer/posed_images.hpp"

#include <fmt/format.h>

#include <iterator>
#include <optional>

#include "apvi/core/error.hpp"
#include "apvi/core/log.hpp"
#include "core/status_line.hpp"
#include "importer/photo_files.hpp"
#include "importer/photo_header.hpp"

namespace apvi::importer {
namespace {

namespace fs = std::filesystem;

std::vector<Stamp> stamps_of(const std::vector<ColmapImage>& images) {
  std::vector<std::string> names;
  for (const ColmapImage& image : images) names.push_back(image.name);
  if (auto named = stamps_of_names(names)) return *named;
  return stamps_a_second_apart(images.size());
}

void check_size(const fs::path& file, const PosedImages& posed) {
  const CameraModel::Parameters& camera = posed.camera;
  const auto header = read_photo_header(file);
  if (!header || (header->size.width == camera.width && header->size.height == camera.height)) {
    return;
  }
  fail_input(
      "{}: is {} x {}, but its {} camera {} x {}; name the folder of the original images with "
      "--images",
      file.string(), header->size.width, header->size.height, posed.program, camera.width,
      camera.height);
}

std::string points_txt(const std::vector<ColmapPoint>& points, double scale) {
  std::string text = "# POINT3D_ID X Y Z R G B ERROR\n";
  std::size_t id = 0;
  for (const ColmapPoint& point : points) {
    const Eigen::Vector3d p = scale * point.position;
    fmt::format_to(std::back_inserter(text), "{} {:.9g} {:.9g} {:.9g} {} {} {} 0\n", ++id, p.x(),
                   p.y(), p.z(), point.color[0], point.color[1], point.color[2]);
  }
  return text;
}

// Copies the images whose files exist and returns their poses; nullopt when interrupted.
std::optional<Trajectory> add_images(const fs::path& folder, const std::vector<ColmapImage>& images,
                                     const ImportOptions& options, double scale, DiveWriter& dive) {
  Trajectory poses;
  const std::vector<Stamp> stamps = stamps_of(images);
  std::size_t missing = 0;
  std::size_t masks = 0;
  StatusLine status("reading images");
  for (std::size_t i = 0; i < images.size(); ++i) {
    if (options.interrupted()) return std::nullopt;
    status.update(static_cast<double>(i) / static_cast<double>(images.size()),
                  fmt::format("{} of {} images", i, images.size()));
    if (!fs::exists(folder / images[i].name)) {
      ++missing;
      continue;
    }
    add_photo(folder / images[i].name, stamps[i], options.images, dive);
    masks += add_mask(options.mask_folder, images[i].name, options.images, dive) ? 1 : 0;
    SE3 T_world_camera = images[i].T_camera_world.inverse();
    T_world_camera.translation *= scale;
    poses.poses.push_back({stamps[i], T_world_camera});
  }
  status.finish();
  if (missing > 0) log::warning("{} of {} images have no file", missing, images.size());
  report_masks(options.mask_folder, masks, poses.poses.size());
  return poses;
}

}  // namespace

ImportResult import_posed(const fs::path& files, const PosedImages& posed,
                          const ImportOptions& options, DiveWriter& dive) {
  ImportResult result;
  check_size(files / posed.images.front().name, posed);
  const auto poses = add_images(files, posed.images, options, posed.scale, dive);
  result.interrupted = !poses;
  if (!poses) return result;
  result.poses = poses->size();
  result.points = posed.points.size();
  dive.write_poses(*poses);
  if (!posed.points.empty()) {
    dive.write_text("points3D.txt", points_txt(posed.points, posed.scale));
  }
  dive.write_text("rig.yaml",
                  camera_yaml(scaled(posed.camera, options.images.scale), dive.image_rate_hz(),
                              "calibration of " + posed.program + "; the body is the camera"));
  return result;
}

}  // namespace apvi::importer
