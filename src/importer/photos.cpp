// SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <map>
#include <numbers>
#include <utility>

#include "apvi/core/error.hpp"
#include "apvi/core/log.hpp"
#include "core/status_line.hpp"
#include "core/text.hpp"
#include "importer/photo_files.hpp"
#include "importer/photo_header.hpp"
#include "importer/sources.hpp"

namespace apvi::importer {
namespace {

namespace fs = std::filesystem;

struct Photo {
  fs::path path;
  PhotoHeader header;
};

// EXIF focal lengths of real lenses (35 mm equivalent), from a fisheye to a telescope [mm]. Cameras
// that do not know theirs write 0, 1 or 65535.
constexpr double kShortestLens = 4.0;
constexpr double kLongestLens = 2000.0;

bool is_same(ImageSize a, ImageSize b) {
  return a.width == b.width && a.height == b.height;
}

// The size of most photographs; the first of these sizes if several are as frequent.
ImageSize usual_size(const std::vector<Photo>& photos) {
  ImageSize usual = photos.front().header.size;
  std::ptrdiff_t most = 0;
  std::map<std::pair<int, int>, std::ptrdiff_t> counts;
  for (const Photo& photo : photos) {
    ++counts[{photo.header.size.width, photo.header.size.height}];
  }
  for (const Photo& photo : photos) {
    const std::ptrdiff_t count = counts[{photo.header.size.width, photo.header.size.height}];
    if (count <= most) continue;
    most = count;
    usual = photo.header.size;
  }
  return usual;
}

// Photographs of one size. One camera model cannot describe others, such as a thumbnail among them.
std::vector<Photo> read_headers(const std::vector<fs::path>& files) {
  std::vector<Photo> photos;
  std::size_t damaged = 0;
  for (const fs::path& path : files) {
    const auto header = read_photo_header(path);
    if (header) photos.push_back({path, *header});
    if (!header && damaged++ == 0) log::warning("{}: not an image; skipped", path.string());
  }
  if (photos.empty()) return photos;
  const ImageSize usual = usual_size(photos);
  const auto is_other = [&](const Photo& photo) { return !is_same(photo.header.size, usual); };
  const auto first = std::find_if(photos.begin(), photos.end(), is_other);
  if (first != photos.end()) {
    log::warning("{}: {} x {}, but those used are {} x {}; skipped", first->path.string(),
                 first->header.size.width, first->header.size.height, usual.width, usual.height);
  }
  const std::size_t other = std::erase_if(photos, is_other);
  if (damaged + other > 1) log::warning("{} files skipped", damaged + other);
  return photos;
}

// Stamps in the names; or EXIF times if all photographs have one and they increase; else a second
// apart.
std::vector<Stamp> stamps_of(const std::vector<Photo>& photos) {
  std::vector<Stamp> stamps;
  std::vector<std::string> names;
  for (const Photo& photo : photos) names.push_back(photo.path.filename().string());
  if (auto named = stamps_of_names(names)) return *named;
  for (const Photo& photo : photos) {
    const Stamp taken{photo.header.taken_ns.value_or(-1)};
    if (taken.ns < 0 || (!stamps.empty() && taken <= stamps.back())) break;
    stamps.push_back(taken);
  }
  if (stamps.size() == photos.size()) return stamps;
  log::info("no EXIF times that increase from image to image; images are a second apart");
  return stamps_a_second_apart(photos.size());
}

std::optional<FieldOfView> field_of_view(const PhotoHeader& header) {
  if (!header.focal_length_35mm) return std::nullopt;
  if (*header.focal_length_35mm < kShortestLens || *header.focal_length_35mm > kLongestLens) {
    log::warning("EXIF: a focal length of {} mm is none of a lens; it is not used",
                 *header.focal_length_35mm);
    return std::nullopt;
  }
  const double half = std::atan(18.0 / *header.focal_length_35mm);
  return FieldOfView{.degrees = 2.0 * half * 180.0 / std::numbers::pi,
                     .in_air = true,
                     .stated = true,
                     .origin = fmt::format("the EXIF focal length of {} mm (35 mm equivalent)",
                                           *header.focal_length_35mm)};
}

}  // namespace

std::vector<fs::path> list_photos(const fs::path& folder) {
  std::vector<fs::path> files;
  std::error_code unreadable;
  for (const auto& entry : fs::directory_iterator(folder, unreadable)) {
    const std::string extension = text::to_lower(entry.path().extension().string());
    const bool image = extension == ".jpg" || extension == ".jpeg" || extension == ".png";
    if (image && entry.is_regular_file()) files.push_back(entry.path());
  }
  std::sort(files.begin(), files.end(), [](const fs::path& a, const fs::path& b) {
    return natural_less(a.filename().string(), b.filename().string());
  });
  return files;
}

ImportResult import_photos(const fs::path& folder, const ImportOptions& options, DiveWriter& dive) {
  ImportResult result;
  const std::vector<Photo> photos = read_headers(list_photos(folder));
  if (photos.empty()) fail_input("{}: no JPEG or PNG image in this folder", folder.string());
  const std::vector<Stamp> stamps = stamps_of(photos);
  StatusLine status("reading images");
  std::size_t masks = 0;
  for (std::size_t i = 0; i < photos.size(); ++i) {
    if (options.interrupted()) {
      result.interrupted = true;
      return result;
    }
    status.update(static_cast<double>(i) / static_cast<double>(photos.size()),
                  fmt::format("{} of {} images", i, photos.size()));
    add_photo(photos[i].path, stamps[i], options.images, dive);
    masks += add_mask(options.mask_folder, photos[i].path.filename(), options.images, dive) ? 1 : 0;
  }
  status.finish();
  report_masks(options.mask_folder, masks, photos.size());
  const PhotoHeader& first = photos.front().header;
  const CameraRig rig = make_camera_rig(options, field_of_view(first),
                                        scaled(first.size, options.images.scale), dive);
  result.interrupted = options.interrupted();
  result.assumed_camera = rig.assumed;
  dive.write_text("rig.yaml", rig.yaml);
  return result;
}

}  // namespace apvi::importer
