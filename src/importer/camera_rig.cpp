// SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>

#include <utility>

#include "apvi/config/node.hpp"
#include "apvi/core/error.hpp"
#include "apvi/core/log.hpp"
#include "apvi/sensors/rig.hpp"
#include "importer/lens_choice.hpp"
#include "importer/lens_tracks.hpp"
#include "importer/sources.hpp"

namespace apvi::importer {
namespace {

// A given rig is copied with its comments resolved; its size must be that of the images.
CameraRig given_rig(const std::filesystem::path& file, ImageSize size) {
  const config::Node node = config::load_with_inheritance(file);
  Rig rig = make_rig(node);
  if (rig.cameras.empty()) fail_input("{}: has no cam0", file.string());
  const CameraModel::Parameters& p = rig.cameras.front().model.parameters();
  if (p.width != size.width || p.height != size.height) {
    fail_input("{}: cam0.resolution: {} x {}, but the images are {} x {} after --scale",
               file.string(), p.width, p.height, size.width, size.height);
  }
  return {.yaml = config::to_yaml(node), .given = std::move(rig)};
}

LensChoice lens_by_images(const FieldOfView& view, const ImportOptions& options, ImageSize size,
                          const DiveWriter& dive) {
  if (view.stated) return {view, ""};
  const FollowedCorners corners = follow_corners(dive.image_files(), size, options.interrupted);
  LensChoice choice = choose_lens(view, corners.size, !options.in_air, corners.segments);
  log::info("cam0: lens: {}", choice.evidence);
  return choice;
}

std::string note_of(const LensChoice& choice, bool under_water) {
  const FieldOfView& view = choice.view;
  const std::string port = view.in_air && under_water ? ", behind a flat port under water" : "";
  std::string note =
      fmt::format("ASSUMED, not calibrated: {} field of view {:.1f} degrees{}, from {}",
                  view.diagonal ? "diagonal" : "horizontal", view.degrees, port, view.origin);
  if (!choice.evidence.empty()) note += fmt::format(" ({})", choice.evidence);
  return note;
}

}  // namespace

FieldOfView field_of_view(const ImportOptions& options, const std::optional<FieldOfView>& known) {
  if (!options.fov_deg) return known ? *known : default_field_of_view();
  return {.degrees = *options.fov_deg, .stated = true, .origin = "--fov"};
}

CameraRig make_camera_rig(const ImportOptions& options, const std::optional<FieldOfView>& known,
                          ImageSize size, const DiveWriter& dive, const std::string& pose) {
  if (!options.rig.empty()) return given_rig(options.rig, size);
  const LensChoice lens = lens_by_images(field_of_view(options, known), options, size, dive);
  const CameraModel::Parameters camera = assumed_camera(lens.view, size, !options.in_air);
  const std::string note = note_of(lens, !options.in_air);
  log::warning("cam0: {}; give --rig or --fov for better results", note);
  return {.yaml = camera_yaml(camera, dive.image_rate_hz(), note, pose), .assumed = true};
}

}  // namespace apvi::importer
