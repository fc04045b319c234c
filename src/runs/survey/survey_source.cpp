// SPDX-License-Identifier: BSD-3-Clause
#include "runs/survey/survey_source.hpp"

#include <torch/torch.h>

#include <algorithm>
#include <filesystem>
#include <optional>
#include <utility>

#include "apvi/core/error.hpp"
#include "apvi/core/log.hpp"
#include "apvi/io/tum.hpp"
#include "apvi/sensors/rig.hpp"
#include "core/median.hpp"
#include "mapping/rendering.hpp"
#include "runs/maps/local_origin.hpp"
#include "runs/maps/stored_map.hpp"
#include "runs/survey/survey_fit.hpp"
#include "slam/camera_conversion.hpp"
#include "survey/vertical_renderer.hpp"

namespace apvi::runs {
namespace {

namespace fs = std::filesystem;

constexpr std::size_t kSamples = 16;
constexpr std::int64_t kSampleSide = 256;  // [px] of the views from above

void add_cameras(SurveySource& survey, const fs::path& run) {
  const CameraMount mount = mount_of_run(*survey.config);
  survey.bodies = io::read_trajectory(run / "keyframes.tum");
  for (const StampedPose& pose : to_local(survey.bodies, survey.origin).poses) {
    survey.views.push_back({view_at(pose.T_world_body, mount)});
  }
  survey.cameras = survey.bodies;
  for (StampedPose& pose : survey.cameras.poses) {
    pose.T_world_body = survey.reference.T_crs_world * pose.T_world_body * mount.T_body_camera;
  }
}

/// Median depth of the surface in a view [m].
std::optional<double> median_depth(const mapping::Map& map, const gaussians::View& view) {
  const mapping::MapRendering drawn = mapping::render_map(map, view);
  const torch::Tensor depths = drawn.depth.index({drawn.alpha >= survey::kKnownAlpha});
  if (depths.size(0) == 0) return std::nullopt;
  return depths.median().item<double>();
}

/// Median over the sampled keyframes of median depth / divisor(view). Throws InputError.
template <typename Divisor>
double median_over_views(const SurveySource& source, const Divisor& divisor) {
  std::vector<double> values;
  for (const gaussians::View& view : sample_views(source)) {
    if (const auto depth = median_depth(source.map.map, view)) {
      values.push_back(*depth / divisor(view));
    }
  }
  if (values.empty()) {
    fail_input("--resolution: required for a map file, or a run whose keyframes show no surface");
  }
  return median(std::move(values));
}

/// Exposure by views from above, at a resolution that shows the whole map in a few of them.
mapping::DisplayExposure exposure_from_above(const survey::SurveyMap& visible) {
  const survey::GroundBounds bounds = survey::bounds_of(visible);
  const double extent = std::max(bounds.east - bounds.west, bounds.north - bounds.south);
  const survey::GroundGrid grid =
      survey::grid_around(bounds, std::max(1e-3, extent / static_cast<double>(kSampleSide)));
  const survey::VerticalView seen = survey::VerticalRenderer(visible).pinhole(grid);
  return mapping::display_exposure(seen.map, {seen.view});
}

survey::Georeference reference_of(const SurveyRequest& request, bool z_down) {
  if (request.positions.empty()) return survey::georeference(request.georeference, z_down);
  const FittedGeoreference fit =
      fit_georeference(load_path(request.source), io::read_trajectory(request.positions),
                       request.georeference.epsg, z_down);
  const Eigen::Vector3d& origin = fit.reference.T_crs_world.translation;
  log::info("georeference: --origin {:.3f},{:.3f},{:.3f} --heading {:.3f}", origin.x(), origin.y(),
            origin.z(), fit.heading_deg);
  log::info("residuals of {} positions: {:.3f} m horizontally (RMS), {:.3f} m at most", fit.fixes,
            fit.horizontal_rms_m, fit.horizontal_max_m);
  return fit.reference;
}

}  // namespace

SurveySource load_survey(const SurveyRequest& request) {
  const fs::path& source = request.source;
  const bool is_run = fs::is_regular_file(source / "resolved.yaml");
  SurveySource out;
  if (is_run) out.config = load_recorded_run_config(source / "resolved.yaml");
  const bool z_down = out.config && make_rig(out.config->rig).world == WorldFrame::ned;
  StoredMap stored = load_drawable_map(source);
  out.origin = stored.origin;
  out.reference = reference_of(request, z_down);
  const map_io::Origin& o = out.origin;
  out.map.T_crs_map =
      out.reference.T_crs_world * SE3{Eigen::Quaterniond::Identity(), {o[0], o[1], o[2]}};
  out.map.map = std::move(stored.map);
  if (out.config && fs::is_regular_file(source / "keyframes.tum")) add_cameras(out, source);
  return out;
}

std::vector<gaussians::View> sample_views(const SurveySource& source) {
  const std::size_t stride = (source.views.size() + kSamples - 1) / kSamples;
  std::vector<gaussians::View> views;
  for (std::size_t i = 0; i < source.views.size(); i += stride) {
    views.push_back(source.views[i].camera);
  }
  return views;
}

double ground_sampling_distance(const SurveySource& source) {
  return median_over_views(source, [](const gaussians::View& v) { return v.intrinsics.fx; });
}

survey::ColorRule colors_of(const SurveySource& source, const survey::SurveyMap& visible,
                            bool restore) {
  survey::ColorRule rule;
  const mapping::Map& map = source.map.map;
  rule.curve = map.tone_curve;
  if (!restore) {
    if (!map.medium) fail_input("--as-seen: the map has no medium");
    const double depth = median_over_views(source, [](const gaussians::View&) { return 1.0; });
    rule.transmission = (-depth * map.medium->beta_d).exp();
  } else if (source.views.empty() || (map.medium && map.medium->lamp)) {
    rule.exposure = exposure_from_above(visible);
  } else {
    rule.exposure = mapping::display_exposure(map, sample_views(source));
  }
  return rule;
}

}  // namespace apvi::runs
