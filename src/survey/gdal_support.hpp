// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <gdal_priv.h>
#include <ogr_spatialref.h>

#include <filesystem>
#include <initializer_list>
#include <optional>

namespace apvi::survey {

using GdalDataset = GDALDatasetUniquePtr;

/// Throws RunError with the file and GDAL's last message.
[[noreturn]] void fail_gdal(const std::filesystem::path& file, const char* what);

/// Gives a finished file its name; the old file of that name is replaced. Throws RunError.
void move_into_place(const std::filesystem::path& finished, const std::filesystem::path& file);

/// A driver. Throws RunError when this GDAL has none of that name.
GDALDriver& gdal_driver(const char* name);

/// Options "KEY=VALUE" as GDAL takes them.
CPLStringList gdal_options(std::initializer_list<const char*> options);

/// The system of an EPSG code, or a local engineering system in meters. Throws InputError, see
/// `well_known_text`.
OGRSpatialReference spatial_reference(const std::optional<int>& epsg);

}  // namespace apvi::survey
