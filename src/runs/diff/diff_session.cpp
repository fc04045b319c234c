// SPDX-License-Identifier: BSD-3-Clause
#include "runs/diff/diff_session.hpp"

#include <torch/torch.h>

#include <utility>

#include "apvi/core/error.hpp"
#include "apvi/io/tum.hpp"
#include "apvi/sensors/rig.hpp"
#include "runs/maps/local_origin.hpp"
#include "runs/maps/stored_map.hpp"

namespace apvi::runs {
namespace {

namespace fs = std::filesystem;

change::Session session_of(const fs::path& run, StoredMap stored, const map_io::Origin& origin) {
  gaussians::Gaussians& map = stored.map.gaussians;
  map.means = rebased(map.means, stored.origin, origin);
  const CameraMount mount = mount_of_run(load_recorded_run_config(run / "resolved.yaml"));
  change::Session session{.map = std::move(stored.map), .views = {}};
  for (const StampedPose& pose :
       to_local(io::read_trajectory(run / "keyframes.tum"), origin).poses) {
    session.views.push_back(view_at(pose.T_world_body, mount));
  }
  return session;
}

}  // namespace

void check_mapping_run(const fs::path& run) {
  if (!fs::is_directory(run)) fail_input("{}: no such folder", run.string());
  for (const char* name : {"resolved.yaml", "map.ply", "keyframes.tum"}) {
    if (fs::is_regular_file(run / name)) continue;
    fail_input("{}: has no {}; expected the folder of a run with a map", run.string(), name);
  }
}

DiffSessions load_sessions(const fs::path& before, const fs::path& after) {
  DiffSessions out;
  StoredMap first = load_drawable_map(before);
  out.origin = first.origin;
  out.before = session_of(before, std::move(first), out.origin);
  out.after = session_of(after, load_drawable_map(after), out.origin);
  out.z_down =
      make_rig(load_recorded_run_config(before / "resolved.yaml").rig).world == WorldFrame::ned;
  return out;
}

DiffColors::DiffColors(const DiffSessions& sessions, const change::ChangeMap& changes)
    : changes_(changes), curve_(sessions.before.map.tone_curve) {
  mapping::Map bare{.gaussians = sessions.before.map.gaussians,
                    .medium = {},
                    .antialiased = sessions.before.map.antialiased};
  exposure_ = mapping::display_exposure(bare, sessions.before.views);
}

torch::Tensor DiffColors::before(const torch::Tensor& light) const {
  return mapping::displayed(light, exposure_, curve_);
}

torch::Tensor DiffColors::after(const torch::Tensor& light) const {
  return before(changes_.as_before(light));
}

}  // namespace apvi::runs
