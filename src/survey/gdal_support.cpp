// SPDX-License-Identifier: BSD-3-Clause
#include "survey/gdal_support.hpp"

#include <cpl_conv.h>
#include <cpl_error.h>

#include <cmath>
#include <mutex>
#include <string>
#include <system_error>

#include "apvi/core/error.hpp"
#include "survey/georeference.hpp"

namespace apvi::survey {
namespace {

/// Messages become those of exceptions.
void register_once() {
  static std::once_flag once;
  std::call_once(once, [] {
    GDALAllRegister();
    CPLSetErrorHandler(CPLQuietErrorHandler);
  });
}

}  // namespace

void fail_gdal(const std::filesystem::path& file, const char* what) {
  const std::string reason = CPLGetLastErrorMsg();
  fail_run("{}: {}: {}", file.string(), what, reason.empty() ? "unknown reason" : reason);
}

void move_into_place(const std::filesystem::path& finished, const std::filesystem::path& file) {
  std::error_code error;
  std::filesystem::rename(finished, file, error);
  if (error) fail_run("{}: cannot be written: {}", file.string(), error.message());
}

GDALDriver& gdal_driver(const char* name) {
  register_once();
  GDALDriver* const driver = GetGDALDriverManager()->GetDriverByName(name);
  if (driver == nullptr) fail_run("this GDAL has no driver {}; install the package gdal-bin", name);
  return *driver;
}

CPLStringList gdal_options(std::initializer_list<const char*> options) {
  CPLStringList list;
  for (const char* option : options) list.AddString(option);
  return list;
}

OGRSpatialReference spatial_reference(const std::optional<int>& epsg) {
  register_once();
  OGRSpatialReference system;
  system.SetAxisMappingStrategy(OAMS_TRADITIONAL_GIS_ORDER);
  if (!epsg) {
    system.SetLocalCS("local survey");
    system.SetLinearUnits(SRS_UL_METER, 1.0);
    return system;
  }
  if (system.importFromEPSG(*epsg) != OGRERR_NONE) {
    fail_input("--epsg: {} is not known to PROJ; see https://epsg.org", *epsg);
  }
  if (system.IsProjected() == 0 || std::abs(system.GetLinearUnits() - 1.0) > 1e-9) {
    fail_input("--epsg: {} is {}; give a projected system in meters, such as UTM: 32600 + zone",
               *epsg, system.GetName());
  }
  return system;
}

std::string well_known_text(const std::optional<int>& epsg) {
  char* text = nullptr;
  const char* const options[] = {"FORMAT=WKT1", nullptr};
  spatial_reference(epsg).exportToWkt(&text, options);
  std::string out = text == nullptr ? "" : text;
  CPLFree(text);
  return out;
}

}  // namespace apvi::survey
