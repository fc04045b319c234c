// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <fstream>
#include <iterator>
#include <map>

#include "apvi/core/error.hpp"
#include "apvi/core/log.hpp"
#include "core/text.hpp"
#include "importer/metashape_model.hpp"
#include "importer/photo_files.hpp"
#include "importer/posed_images.hpp"
#include "importer/sources.hpp"

namespace apvi::importer {
namespace {

namespace fs = std::filesystem;

bool is_metashape_file(const fs::path& path) {
  constexpr std::size_t kBegin = 4096;
  if (text::to_lower(path.extension().string()) != ".xml") return false;
  std::string begin(kBegin, '\0');
  std::ifstream in(path, std::ios::binary);
  in.read(begin.data(), kBegin);
  return is_metashape(begin);
}

// Files by their name, and by their name without its ending: labels are either.
std::map<std::string, std::string> names_of_images(const fs::path& folder) {
  std::map<std::string, std::string> names;
  for (const fs::path& path : list_photos(folder)) {
    names[path.filename().string()] = path.filename().string();
    names.emplace(path.stem().string(), path.filename().string());
  }
  return names;
}

fs::path find_images(const fs::path& xml, const ImportOptions& options) {
  if (!options.image_folder.empty()) return options.image_folder;
  const fs::path beside = fs::absolute(xml).parent_path();
  for (const fs::path& place : {beside / "images", beside}) {
    if (fs::is_directory(place) && !list_photos(place).empty()) return place;
  }
  fail_input("{}: its images are not in {}; name their folder with --images", xml.string(),
             (beside / "images").string());
}

std::vector<ColmapImage> images_of(const MetashapeModel& model, const fs::path& folder,
                                   const fs::path& xml) {
  const std::map<std::string, std::string> names = names_of_images(folder);
  std::vector<ColmapImage> images;
  for (const MetashapeImage& image : model.images) {
    const auto name = names.find(image.label);
    if (name == names.end()) continue;
    images.push_back({.name = name->second, .T_camera_world = image.T_model_camera.inverse()});
  }
  const std::size_t missing = model.images.size() - images.size();
  if (images.empty()) {
    fail_input("{}: no image of it is in {}; name the folder with --images", xml.string(),
               folder.string());
  }
  if (missing > 0) log::warning("{} of {} images have no file", missing, model.images.size());
  std::ranges::sort(images, natural_less, &ColmapImage::name);
  return images;
}

}  // namespace

std::optional<fs::path> find_metashape_cameras(const fs::path& source) {
  std::error_code unreadable;
  if (!fs::is_directory(source, unreadable)) {
    return is_metashape_file(source) ? std::optional(source) : std::nullopt;
  }
  std::vector<fs::path> found;
  for (const auto& entry : fs::directory_iterator(source, unreadable)) {
    if (is_metashape_file(entry.path())) found.push_back(entry.path());
  }
  return found.size() == 1 ? std::optional(found.front()) : std::nullopt;
}

ImportResult import_metashape(const fs::path& source, const ImportOptions& options,
                              DiveWriter& dive) {
  const fs::path xml = find_metashape_cameras(source).value_or(source);
  std::ifstream in(xml, std::ios::binary);
  const MetashapeModel model =
      parse_metashape({std::istreambuf_iterator<char>(in), {}}, xml.string());
  if (model.of_other_sensors > 0) {
    log::warning("{} images are of another sensor; skipped", model.of_other_sensors);
  }
  const fs::path folder = find_images(xml, options);
  const double given = options.meters_per_unit;
  const PosedImages posed{.camera = model.camera,
                          .images = images_of(model, folder, xml),
                          .points = {},
                          .scale = given > 0.0 ? given : model.scale.value_or(1.0),
                          .program = "Metashape"};
  ImportResult result = import_posed(folder, posed, options, dive);
  result.has_metric_poses = model.scale.has_value();
  return result;
}

}  // namespace apvi::importer
