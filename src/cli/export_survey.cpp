// SPDX-License-Identifier: BSD-3-Clause
#include "cli/export_survey.hpp"

#include <vector>

#include "core/interrupt.hpp"

namespace apvi::cli {
namespace {

void add_georeference(CLI::App& command, runs::SurveyRequest& request) {
  survey::GeoreferenceOptions& g = request.georeference;
  command
      .add_option("--epsg", g.epsg,
                  "EPSG code of a projected coordinate system in meters; default: a local system")
      ->check(CLI::PositiveNumber)
      ->type_name("N")
      ->group("Survey products");
  CLI::Option* const origin =
      command
          .add_option_function<std::vector<double>>(
              "--origin",
              [&g](const std::vector<double>& v) {
                g.origin = {v[0], v[1], v.size() > 2 ? v[2] : 0.0};
              },
              "coordinates of the recording's origin: EASTING,NORTHING[,HEIGHT] [m]; default: zero")
          ->delimiter(',')
          ->expected(2, 3)
          ->type_name("E,N[,H]")
          ->group("Survey products");
  CLI::Option* const heading =
      command
          .add_option("--heading", g.heading_deg,
                      "direction of the recording's x axis, clockwise from grid north [deg]; "
                      "default: 90 (x is east), or 0 (x is north) if the recording's z is down")
          ->check(CLI::Range(-360.0, 360.0))
          ->type_name("DEG")
          ->group("Survey products");
  command
      .add_option(
          "--positions", request.positions,
          "positions in that system to fit the run to, instead of --origin and --heading: a "
          "file with the columns time, east, north, up, such as gnss0/data.csv")
      ->excludes(origin)
      ->excludes(heading)
      ->type_name("FILE")
      ->group("Survey products");
}

}  // namespace

void add_survey_options(CLI::App& command, runs::SurveyRequest& request) {
  command
      .add_option(
          "--resolution", request.resolution_m,
          "size of a pixel on the ground, or of a voxel of the mesh [m]; default: the ground "
          "sampling distance of the images, rounded up to 1, 2 or 5 times a power of ten, "
          "or twice that distance for a mesh")
      ->check(CLI::PositiveNumber)
      ->type_name("METERS")
      ->group("Survey products");
  command
      .add_flag_callback(
          "--map-depth", [&request] { request.compare_images = false; },
          "elevation, mesh, survey: leave surfaces where the map shows them, instead of comparing "
          "the recording's images around them")
      ->group("Survey products");
  command
      .add_flag_callback(
          "--as-seen", [&request] { request.restore = false; },
          "colors attenuated by the water as at the survey's median range, instead of restored")
      ->group("Survey products");
  command
      .add_option("--contour-interval", request.contour_interval_m,
                  "height between contour lines [m]; default: 0.1")
      ->check(CLI::PositiveNumber)
      ->type_name("METERS")
      ->group("Survey products");
  add_georeference(command, request);
}

void export_survey_product(runs::SurveyRequest request) {
  const InterruptGuard guard;
  request.interrupted = [&guard] { return guard.interrupted(); };
  runs::export_survey(request);
}

}  // namespace apvi::cli
