// SPDX-License-Identifier: BSD-3-Clause
#include "runs/views/render_run.hpp"

#include <fmt/format.h>
#include <torch/torch.h>

#include <optional>
#include <string>
#include <system_error>
#include <utility>
#include <vector>

#include "apvi/core/error.hpp"
#include "apvi/core/log.hpp"
#include "apvi/io/tum.hpp"
#include "core/status_line.hpp"
#include "gaussians/detail/detail_levels.hpp"
#include "mapping/appearance/display_exposure.hpp"
#include "mapping/rendering.hpp"
#include "mapping/surface_depth.hpp"
#include "runs/maps/local_origin.hpp"
#include "runs/maps/stored_map.hpp"
#include "runs/views/image_files.hpp"

namespace apvi::runs {
namespace {

namespace fs = std::filesystem;

struct NamedView {
  std::string name;
  gaussians::View view;
};

std::vector<NamedView> views_along(const fs::path& path, const CameraMount& mount,
                                   const map_io::Origin& origin) {
  const Trajectory trajectory = to_local(io::read_trajectory(path), origin);
  if (!trajectory.has_rotation) fail_input("{}: has positions only", path.string());
  std::vector<NamedView> views;
  for (const StampedPose& pose : trajectory.poses) {
    views.push_back({std::to_string(pose.stamp.ns), view_at(pose.T_world_body, mount)});
  }
  if (views.empty()) fail_input("{}: contains no poses", path.string());
  return views;
}

std::vector<NamedView> views_of_run(const fs::path& run, const fs::path& path,
                                    const map_io::Origin& origin) {
  return views_along(path, mount_of_run(load_recorded_run_config(run / "resolved.yaml")), origin);
}

std::vector<NamedView> choose_views(const RenderRequest& r, const fs::path& map,
                                    const map_io::Origin& origin) {
  const bool is_run = fs::is_directory(r.source);
  if (!r.camera.empty()) {
    const gaussians::View view = read_camera_json(r.camera, origin);
    if (r.path.empty()) return {{map.stem().string(), view}};
    return views_along(r.path, {view.intrinsics, SE3::identity()}, origin);
  }
  if (!is_run) {
    fail_input(
        "{}: a map file has no cameras: use --camera FILE, and --path FILE for more than one view",
        r.source.string());
  }
  return views_of_run(r.source, r.path.empty() ? r.source / "keyframes.tum" : r.path, origin);
}

/// The same for all views of a map: by the keyframes of a run, otherwise by what is rendered.
mapping::DisplayExposure exposure_of(const RenderRequest& r, const mapping::Map& map,
                                     const std::vector<NamedView>& rendered,
                                     const map_io::Origin& origin) {
  if (!r.restore || !map.medium) return {};
  const fs::path keyframes = r.source / "keyframes.tum";
  const bool is_run = fs::is_regular_file(keyframes);
  std::vector<gaussians::View> views;
  for (const NamedView& view : is_run ? views_of_run(r.source, keyframes, origin) : rendered)
    views.push_back(view.view);
  mapping::DisplayExposure chosen = mapping::display_exposure(map, views, r.white_balance);
  if (r.exposure) chosen.brightness = *r.exposure;
  const auto [red, green, blue] = chosen.gains();
  log::info("restored images: red, green and blue times {:.3g}, {:.3g}, {:.3g}", red, green, blue);
  return chosen;
}

/// Renders the views of a map, in less detail where that is asked for.
class DetailedMap {
 public:
  DetailedMap(const mapping::Map& map, double detail_px) : drawn_(map), detail_px_(detail_px) {
    if (detail_px > 0.0) levels_.emplace(map.gaussians);
  }

  mapping::MapRendering render(const gaussians::View& view, bool surface_depth) {
    if (levels_) drawn_.gaussians = levels_->select(view, detail_px_);
    mapping::MapRendering out = mapping::render_map(drawn_, view);
    if (surface_depth) out.depth = mapping::surface_depth(drawn_, view, out.depth, out.alpha);
    return out;
  }

 private:
  mapping::Map drawn_;
  double detail_px_;
  std::optional<gaussians::DetailLevels> levels_;
};

struct Writers {
  using Write = void (*)(const fs::path&, const torch::Tensor&);
  const char* extension;
  Write color, depth;
};

Writers writers_for(const RenderRequest& r) {
  switch (r.format) {
    case ImageFormat::pfm:
      return {".pfm", write_pfm, write_pfm};
    case ImageFormat::exr:
      return {".exr", write_exr, write_exr};
    case ImageFormat::png:
      break;
  }
  return {".png", r.bits == 16 ? write_png_16 : write_png, write_depth_png};
}

void write_rendering(const mapping::MapRendering& rendering, const gaussians::ToneCurve& curve,
                     const RenderRequest& r, const std::string& name,
                     const mapping::DisplayExposure& exposure) {
  const Writers write = writers_for(r);
  const auto file = [&](const char* kind) { return r.out / (name + kind + write.extension); };
  const bool linear = r.format == ImageFormat::exr;
  write.color(file(""), linear ? rendering.color : curve.encode(rendering.color));
  if (r.restore) {
    write.color(file("_restored"), r.format == ImageFormat::png
                                       ? mapping::displayed(rendering.restored, exposure, curve)
                                       : mapping::exposed(rendering.restored, exposure));
  }
  if (r.depth) write.depth(file("_depth"), rendering.depth);
}

}  // namespace

std::size_t render_run(const RenderRequest& request) {
  const fs::path file = map_file_of(request.source);
  const StoredMap stored = load_drawable_map(request.source);
  const mapping::Map& map = stored.map;
  if (request.restore && !map.medium) {
    log::warning("{}: the map has no medium; --restore has no effect", file.string());
  }
  const auto views = choose_views(request, file, stored.origin);
  std::error_code error;
  fs::create_directories(request.out, error);
  if (error) fail_run("{}: cannot create folder: {}", request.out.string(), error.message());
  StatusLine status("rendering");
  const mapping::DisplayExposure exposure = exposure_of(request, map, views, stored.origin);
  DetailedMap detailed(map, request.detail_px);
  std::size_t done = 0;
  for (const auto& [name, view] : views) {
    const mapping::MapRendering rendering = detailed.render(view, request.depth);
    write_rendering(rendering, map.tone_curve, request, name, exposure);
    status.update(static_cast<double>(++done) / static_cast<double>(views.size()), name);
  }
  return done;
}

}  // namespace apvi::runs
