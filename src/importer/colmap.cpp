// SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>

#include <algorithm>
#include <iterator>

#include "apvi/core/error.hpp"
#include "apvi/core/log.hpp"
#include "core/status_line.hpp"
#include "importer/colmap_model.hpp"
#include "importer/photo_files.hpp"
#include "importer/photo_header.hpp"
#include "importer/sources.hpp"

namespace apvi::importer {
namespace {

namespace fs = std::filesystem;

bool has_model(const fs::path& folder) {
  return (fs::exists(folder / "cameras.bin") || fs::exists(folder / "cameras.txt")) &&
         (fs::exists(folder / "images.bin") || fs::exists(folder / "images.txt"));
}

// Where the first image's file is.
fs::path find_images(const fs::path& folder, const fs::path& model, const ImportOptions& options,
                     const std::string& first) {
  if (!options.image_folder.empty()) {
    if (fs::exists(options.image_folder / first)) return options.image_folder;
    fail_input("--images: {}: no {} in it", options.image_folder.string(), first);
  }
  const fs::path above = fs::absolute(model).lexically_normal();
  for (const fs::path& place :
       {folder / "images", folder, above.parent_path() / "images",
        above.parent_path().parent_path() / "images", above.parent_path()}) {
    if (fs::exists(place / first)) return place;
  }
  fail_input("{}: its images are not in {}; name their folder with --images", folder.string(),
             (folder / "images").string());
}

// A rig has one camera: the one of most images.
std::uint32_t most_used_camera(const ColmapModel& model) {
  std::map<std::uint32_t, std::size_t> count;
  for (const ColmapImage& image : model.images) ++count[image.camera];
  const auto most = std::max_element(
      count.begin(), count.end(), [](const auto& a, const auto& b) { return a.second < b.second; });
  const std::size_t others = model.images.size() - most->second;
  if (others > 0) {
    log::warning(
        "{} of {} images are of another camera; skipped. For one camera reconstruct with "
        "--ImageReader.single_camera 1",
        others, model.images.size());
  }
  return most->first;
}

std::vector<ColmapImage> images_of(const ColmapModel& model, std::uint32_t camera) {
  std::vector<ColmapImage> images;
  std::copy_if(model.images.begin(), model.images.end(), std::back_inserter(images),
               [&](const ColmapImage& i) { return i.camera == camera; });
  std::sort(images.begin(), images.end(), [](const ColmapImage& a, const ColmapImage& b) {
    return natural_less(a.name, b.name);
  });
  return images;
}

std::vector<Stamp> stamps_of(const std::vector<ColmapImage>& images) {
  std::vector<std::string> names;
  for (const ColmapImage& image : images) names.push_back(image.name);
  if (auto named = stamps_of_names(names)) return *named;
  return stamps_a_second_apart(images.size());
}

void check_size(const fs::path& file, const CameraModel::Parameters& camera) {
  const auto header = read_photo_header(file);
  if (!header || (header->size.width == camera.width && header->size.height == camera.height)) {
    return;
  }
  fail_input(
      "{}: is {} x {}, but its COLMAP camera {} x {}; name the folder of the original images "
      "with --images",
      file.string(), header->size.width, header->size.height, camera.width, camera.height);
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

std::optional<fs::path> find_colmap_model(const fs::path& folder) {
  for (const fs::path& place :
       {folder, folder / "sparse" / "0", folder / "sparse", folder / "colmap" / "sparse" / "0"}) {
    if (has_model(place)) return place;
  }
  return std::nullopt;
}

ImportResult import_colmap(const fs::path& folder, const ImportOptions& options, DiveWriter& dive) {
  ImportResult result;
  const auto place = find_colmap_model(folder);
  if (!place) fail_input("{}: no COLMAP model in it", folder.string());
  const ColmapModel model = read_colmap_model(*place);
  if (model.images.empty()) fail_input("{}: the model has no images", place->string());
  const std::uint32_t id = most_used_camera(model);
  if (!model.cameras.contains(id)) fail_input("{}: has no camera {}", place->string(), id);
  const CameraModel::Parameters camera = to_camera(model.cameras.at(id), place->string());
  const std::vector<ColmapImage> images = images_of(model, id);
  const fs::path files = find_images(folder, *place, options, images.front().name);
  check_size(files / images.front().name, camera);
  const double scale = options.meters_per_unit > 0.0 ? options.meters_per_unit : 1.0;
  const auto poses = add_images(files, images, options, scale, dive);
  result.interrupted = !poses;
  if (!poses) return result;
  result.poses = poses->size();
  result.points = model.points.size();
  dive.write_poses(*poses);
  if (!model.points.empty()) dive.write_text("points3D.txt", points_txt(model.points, scale));
  dive.write_text("rig.yaml",
                  camera_yaml(scaled(camera, options.images.scale), dive.image_rate_hz(),
                              "calibration of COLMAP; the body is the camera"));
  return result;
}

}  // namespace apvi::importer
