// SPDX-License-Identifier: BSD-3-Clause
#include "runs/survey/survey_run.hpp"

#include <torch/torch.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdlib>
#include <nlohmann/json.hpp>
#include <string>
#include <system_error>
#include <thread>
#include <vector>

#include "apvi/core/error.hpp"
#include "apvi/core/log.hpp"
#include "apvi/io/tum.hpp"
#include "core/status_line.hpp"
#include "map_io/map_file.hpp"
#include "runs/maps/local_origin.hpp"
#include "runs/survey/survey_depth.hpp"
#include "runs/survey/survey_source.hpp"
#include "survey/geotiff.hpp"
#include "survey/ground_products.hpp"
#include "survey/height_fusion.hpp"
#include "survey/las.hpp"
#include "survey/mesh.hpp"
#include "survey/poses.hpp"
#include "survey/visibility.hpp"

namespace apvi::runs {
namespace {

namespace fs = std::filesystem;

/// A request and what it is about.
struct Work {
  const SurveyRequest& request;
  const SurveySource& source;
  const survey::SurveyMap& visible;  ///< what can be seen from above
  survey::Progress progress;
};

/// The smallest of 1, 2 and 5 times a power of ten that is not below `value`.
double rounded_up(double value) {
  const double power = std::pow(10.0, std::floor(std::log10(value)));
  for (const double step : {1.0, 2.0, 5.0}) {
    if (step * power >= value * (1.0 - 1e-9)) return step * power;
  }
  return 10.0 * power;
}

double resolution_of(const SurveyRequest& r, const SurveySource& source) {
  if (r.resolution_m) return *r.resolution_m;
  const double distance = ground_sampling_distance(source);
  const double resolution = rounded_up(distance);
  log::info("resolution {:.4g} m: the images' ground sampling distance is {:.4g} m", resolution,
            distance);
  return resolution;
}

survey::Progress progress_of(const SurveyRequest& r, StatusLine& status, const std::string& what) {
  return [&r, &status, what](double fraction) {
    if (r.interrupted()) fail_run("{}: interrupted; nothing was written", r.out.string());
    status.update(fraction, what);
  };
}

void need_cameras(const SurveyRequest& r, const SurveySource& source) {
  if (source.cameras.empty()) {
    fail_input("{}: has no keyframes; --format {} needs a run folder", r.source.string(),
               r.product);
  }
}

void make_orthomosaic(const Work& w, const survey::GroundProduct& product) {
  const fs::path file = w.request.out / "orthomosaic.tif";
  survey::write_orthomosaic(file, product, colors_of(w.source, w.visible, w.request.restore));
  log::info("{} x {} pixels of {:.4g} m in {}", product.grid.width, product.grid.height,
            product.grid.resolution_m, file.string());
}

void make_elevation(const Work& w, const survey::GroundProduct& product) {
  const fs::path& out = w.request.out;
  const std::int64_t known = survey::write_elevation(out / "elevation.tif", product);
  survey::write_hillshade(out / "elevation.tif", out / "hillshade.tif");
  survey::write_contours(out / "elevation.tif", out / "contours.gpkg",
                         w.request.contour_interval_m);
  const double pixel = product.grid.resolution_m;
  log::info("{:.4g} m² of ground in {}: elevation.tif, hillshade.tif, contours.gpkg",
            static_cast<double>(known) * pixel * pixel, out.string());
}

survey::GroundProduct ground_product(const Work& w) {
  const double resolution = resolution_of(w.request, w.source);
  survey::GroundProduct product{w.visible, w.source.reference,
                                survey::grid_around(survey::bounds_of(w.visible), resolution),
                                w.progress};
  if (!w.source.views.empty()) {
    product.heights = survey::HeightFusion(w.source.map, w.source.views);
  }
  return product;
}

void make_ground_product(const Work& w) {
  const survey::GroundProduct product = ground_product(w);
  w.request.product == "orthomosaic" ? make_orthomosaic(w, product) : make_elevation(w, product);
}

void make_las(const Work& w) {
  const fs::path file = w.request.out / "points.las";
  const survey::SurfacePoints points =
      survey::surface_points(w.visible, colors_of(w.source, w.visible, w.request.restore));
  survey::write_las(file, points, w.source.reference);
  log::info("{} points in {}", points.positions.size(0), file.string());
}

void make_poses(const Work& w) {
  need_cameras(w.request, w.source);
  const fs::path file = w.request.out / "poses.csv";
  survey::write_poses(file, w.source.cameras.poses);
  log::info("{} poses in {}", w.source.cameras.size(), file.string());
}

void make_mesh(const Work& w) {
  need_cameras(w.request, w.source);
  const fs::path& out = w.request.out;
  const survey::Mesh mesh = survey::fuse(
      w.source.map.map, w.source.views, colors_of(w.source, w.visible, w.request.restore),
      w.request.resolution_m.value_or(2.0 * ground_sampling_distance(w.source)), w.progress);
  if (mesh.triangles.size(0) == 0) {
    fail_input("{}: no keyframe shows a surface", w.request.source.string());
  }
  const map_io::Origin origin = local_origin(w.source.cameras);
  const SE3 T_file_crs{Eigen::Quaterniond::Identity(), {-origin[0], -origin[1], -origin[2]}};
  for (const char* name : {"mesh.ply", "mesh.glb"}) {
    survey::write_mesh(out / name, mesh, T_file_crs * w.source.map.T_crs_map);
  }
  map_io::write_origin_json(out / "origin.json", origin);
  log::info("{} vertices and {} triangles in {}: mesh.ply, mesh.glb", mesh.vertices.size(0),
            mesh.triangles.size(0), out.string());
}

void make_report(const Work& w) {
  const survey::GroundProduct product = ground_product(w);
  const survey::TerrainStatistics terrain = survey::terrain_of(product);
  if (terrain.cells() == 0) fail_input("{}: shows no ground", w.request.source.string());
  nlohmann::ordered_json json = {{"resolution_m", product.grid.resolution_m},
                                 {"keyframes", w.source.cameras.size()},
                                 {"area_m2", terrain.planar_area_m2()},
                                 {"surface_area_m2", terrain.surface_area_m2()},
                                 {"rugosity", terrain.rugosity()},
                                 {"mean_slope_deg", terrain.mean_slope_deg()},
                                 {"lowest_m", terrain.lowest_m()},
                                 {"highest_m", terrain.highest_m()},
                                 {"volume_above_lowest_m3", terrain.volume_above_lowest_m3()}};
  if (!w.source.views.empty()) {
    json["ground_sampling_distance_m"] = ground_sampling_distance(w.source);
  }
  const fs::path file = w.request.out / "survey.json";
  io::write_text_file(file, json.dump(1) + "\n");
  log::info("{:.4g} m² of ground, rugosity {:.4g}, heights {:.4g} to {:.4g} m: {}",
            terrain.planar_area_m2(), terrain.rugosity(), terrain.lowest_m(), terrain.highest_m(),
            file.string());
}

struct Product {
  const char* word;
  void (*make)(const Work&);
  bool shows_ground = true;    ///< whether it needs what can be seen from above
  bool measures_depth = true;  ///< whether it is about where surfaces are
};
constexpr std::array kProducts = {Product{"orthomosaic", make_ground_product, true, false},
                                  Product{"elevation", make_ground_product},
                                  Product{"las", make_las, true, false},
                                  Product{"poses", make_poses, false, false},
                                  Product{"mesh", make_mesh},
                                  Product{"survey", make_report}};

const Product* find_product(const std::string& word) {
  const auto* const found = std::find_if(kProducts.begin(), kProducts.end(),
                                         [&](const Product& p) { return word == p.word; });
  return found == kProducts.end() ? nullptr : found;
}

// Several exports at a time must share them: threads that wait for each other take the time of
// those that work.
int processors() {
  const char* const limit = std::getenv("OMP_NUM_THREADS");
  const int asked = limit == nullptr ? 0 : std::atoi(limit);
  return asked > 0 ? asked : static_cast<int>(std::max(1U, std::thread::hardware_concurrency()));
}

}  // namespace

bool is_survey_product(const std::string& word) {
  return find_product(word) != nullptr;
}

void export_survey(const SurveyRequest& request) {
  const Product* const product = find_product(request.product);
  if (product == nullptr) fail_input("--format: {} is no product of a survey", request.product);
  torch::set_num_threads(processors());
  SurveySource source = load_survey(request);
  const survey::SurveyMap visible =
      product->shows_ground ? survey::seen_from_above(source.map, survey::cameras_of(source.views))
                            : survey::SurveyMap{};
  std::error_code error;
  fs::create_directories(request.out, error);
  if (error) fail_run("{}: cannot create folder: {}", request.out.string(), error.message());
  if (request.compare_images && product->measures_depth) {
    StatusLine status("comparing images");
    compare_survey_images(source, progress_of(request, status, ""));
  }
  StatusLine status("exporting");
  product->make({request, source, visible, progress_of(request, status, request.product)});
}

}  // namespace apvi::runs
