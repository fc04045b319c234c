// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <iterator>
#include <utility>

#include "apvi/core/error.hpp"
#include "apvi/core/log.hpp"
#include "importer/colmap_model.hpp"
#include "importer/photo_files.hpp"
#include "importer/posed_images.hpp"
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

}  // namespace

std::optional<fs::path> find_colmap_model(const fs::path& folder) {
  for (const fs::path& place :
       {folder, folder / "sparse" / "0", folder / "sparse", folder / "colmap" / "sparse" / "0"}) {
    if (has_model(place)) return place;
  }
  return std::nullopt;
}

ImportResult import_colmap(const fs::path& folder, const ImportOptions& options, DiveWriter& dive) {
  const auto place = find_colmap_model(folder);
  if (!place) fail_input("{}: no COLMAP model in it", folder.string());
  ColmapModel model = read_colmap_model(*place);
  if (model.images.empty()) fail_input("{}: the model has no images", place->string());
  const std::uint32_t id = most_used_camera(model);
  if (!model.cameras.contains(id)) fail_input("{}: has no camera {}", place->string(), id);
  const PosedImages posed{.camera = to_camera(model.cameras.at(id), place->string()),
                          .images = images_of(model, id),
                          .points = std::move(model.points),
                          .scale = options.meters_per_unit > 0.0 ? options.meters_per_unit : 1.0,
                          .program = "COLMAP"};
  const fs::path files = find_images(folder, *place, options, posed.images.front().name);
  return import_posed(files, posed, options, dive);
}

}  // namespace apvi::importer
