// SPDX-License-Identifier: BSD-3-Clause
#include "runs/diff/diff_images.hpp"

#include <fmt/format.h>
#include <torch/torch.h>

#include <algorithm>
#include <cmath>

#include "change/surface_view.hpp"
#include "mapping/rendering.hpp"
#include "runs/views/image_files.hpp"

namespace apvi::runs {
namespace {

using torch::Tensor;

constexpr int kSide = 320;          // [px] of the images of a change
constexpr double kMargin = 2.5;     // side of the image by that of the change
constexpr double kMinSide_m = 0.4;  // of what is shown around it
constexpr double kOpaque = 0.5;

Tensor light_of(const mapping::Map& map, const gaussians::View& view) {
  const mapping::Map bare{.gaussians = map.gaussians, .medium = {}, .antialiased = map.antialiased};
  const mapping::MapRendering drawn = mapping::render_map(bare, view);
  return drawn.restored / drawn.alpha.clamp_min(kOpaque).unsqueeze(2);
}

/// The views of the two sessions that show a change alike.
struct Pair {
  gaussians::View before, after;
};

Pair pair_of(const change::Change& change, const change::Registration& registration) {
  const Tensor T_before_after = registration.motion_at(change.center);
  Pair pair{change.view, change.view};
  if (change.kind == change::Kind::vanished) {
    pair.after.T_camera_world = change.view.T_camera_world.mm(T_before_after);
  } else {
    pair.before.T_camera_world = change.view.T_camera_world.mm(T_before_after.inverse());
  }
  return pair;
}

/// A square camera around the points, in the frame of the earlier session.
gaussians::Intrinsics closeup(const gaussians::View& view, const change::Change& change) {
  const Tensor points = change.points.to(torch::kCPU, torch::kFloat64);
  const change::CameraPose pose = change::camera_pose(view, points);
  const Tensor p = points.mm(pose.R.t()) + pose.t;
  const Tensor center = p.mean(0);
  const double z = std::max(0.05, center[2].item<double>());
  const double shown = std::max(kMinSide_m, kMargin * change.length_m);
  const double focal = kSide * z / shown;
  return {.fx = focal,
          .fy = focal,
          .cx = 0.5 * kSide - focal * center[0].item<double>() / z,
          .cy = 0.5 * kSide - focal * center[1].item<double>() / z,
          .width = kSide,
          .height = kSide};
}

}  // namespace

std::string image_name(std::size_t index, change::Kind kind) {
  return fmt::format("images/{:03}_{}", index + 1, change::to_string(kind));
}

void write_change_images(const std::filesystem::path& folder, std::size_t index,
                         const DiffSessions& sessions, const change::ChangeMap& map,
                         const DiffColors& colors) {
  const change::Change& change = map.changes[index];
  Pair pair = pair_of(change, map.registration);
  pair.before.intrinsics = closeup(pair.before, change);
  pair.after.intrinsics = pair.before.intrinsics;
  const std::string name = image_name(index, change.kind);
  write_png(folder / (name + "_before.png"),
            colors.before(light_of(sessions.before.map, pair.before)));
  write_png(folder / (name + "_after.png"), colors.after(light_of(sessions.after.map, pair.after)));
}

}  // namespace apvi::runs
