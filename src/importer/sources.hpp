// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "apvi/sensors/rig.hpp"
#include "importer/dive_writer.hpp"
#include "importer/import.hpp"

/// One function per kind of source. Each fills a folder, except for its import.yaml, and returns
/// what it found.
namespace apvi::importer {

ImportResult import_video(const std::filesystem::path& path, const ImportOptions& options,
                          DiveWriter& dive);
ImportResult import_photos(const std::filesystem::path& folder, const ImportOptions& options,
                           DiveWriter& dive);
ImportResult import_colmap(const std::filesystem::path& folder, const ImportOptions& options,
                           DiveWriter& dive);

/// Cameras exported by Metashape (XML), or a folder with them.
ImportResult import_metashape(const std::filesystem::path& source, const ImportOptions& options,
                              DiveWriter& dive);
/// A vehicle's log, and `options.sensors`, without images.
ImportResult import_log(const std::filesystem::path& path, const ImportOptions& options,
                        DiveWriter& dive);

/// Whether a folder holds a COLMAP model: in itself, in `sparse/0` or in `sparse`. The folder of
/// its cameras file.
std::optional<std::filesystem::path> find_colmap_model(const std::filesystem::path& folder);
/// The XML file with Metashape's cameras: a file, or the only such one of a folder.
std::optional<std::filesystem::path> find_metashape_cameras(const std::filesystem::path& source);
/// JPEG and PNG files of a folder, in natural order ("img2" before "img10").
std::vector<std::filesystem::path> list_photos(const std::filesystem::path& folder);

/// The field of view of an assumed camera: `options.fov_deg`, else `known`, else the default.
FieldOfView field_of_view(const ImportOptions& options, const std::optional<FieldOfView>& known);

/// The rig of images without calibration: `options.rig`, else `options.fov_deg`, else `known`, else
/// the default; with a warning unless a rig was given. A lens that is not stated is replaced by one
/// that explains the dive's images clearly better (`choose_lens`). `size` is that of the images,
/// `pose` the T_body_sensor of an assumed camera, as in rig.yaml.
struct CameraRig {
  std::string yaml;
  bool assumed = false;
  std::optional<Rig> given = {};  ///< that of `options.rig`
};
CameraRig make_camera_rig(const ImportOptions& options, const std::optional<FieldOfView>& known,
                          ImageSize size, const DiveWriter& dive,
                          const std::string& pose = kAtBody);

}  // namespace apvi::importer
