// SPDX-License-Identifier: BSD-3-Clause
#include "apvi/sim/simulate.hpp"

#include <fstream>
#include <sstream>
#include <system_error>

#include "apvi/core/error.hpp"
#include "apvi/core/interrupt.hpp"
#include "apvi/core/log.hpp"
#include "apvi/core/stopwatch.hpp"
#include "formats.hpp"
#include "frames.hpp"

namespace apvi::sim {
namespace {

namespace fs = std::filesystem;

constexpr const char* kIdentity = "truth/scene.yaml";

std::string_view format_name(OutputFormat format) {
  switch (format) {
    case OutputFormat::folder:
      return "folder";
    case OutputFormat::euroc:
      return "euroc";
    case OutputFormat::rosbag:
      return "rosbag";
    case OutputFormat::tank:
      return "tank";
    case OutputFormat::colmap:
      return "colmap";
  }
  return "";
}

// All that the bytes of the data set depend on; stored in it, and the ground for going on or
// refusing.
std::string identity_of(const Scene& scene, OutputFormat format) {
  std::string rig = config::to_yaml(scene.rig_node);
  for (std::size_t at = 0; (at = rig.find('\n', at)) != std::string::npos; at += 3) {
    rig.replace(at, 1, "\n# ");
  }
  return fmt::format("# simulated as {}\n{}\n# with the rig\n# {}\n", format_name(format),
                     config::to_yaml(config::to_node(scene.config)), rig);
}

std::string text_of(const fs::path& path) {
  std::ostringstream text;
  text << std::ifstream(path, std::ios::binary).rdbuf();
  return text.str();
}

bool is_complete(const fs::path& out, const std::string& identity) {
  if (!fs::exists(out)) return false;
  if (fs::is_directory(out) && fs::is_empty(out)) return false;
  if (fs::exists(out / kIdentity) && text_of(out / kIdentity) == identity) return true;
  fail_input("{}: exists and is not the data set of this scene; delete it or choose another -o",
             out.string());
}

void open_partial(const fs::path& partial, const std::string& identity) {
  const fs::path marker = partial / kIdentity;
  if (fs::exists(marker)) {
    if (text_of(marker) == identity) {
      log::info("{}: goes on with what is there", partial.string());
      return;
    }
    fail_input("{}: was begun with another scene, format or version; delete it to start again",
               partial.string());
  }
  if (fs::exists(partial) && !fs::is_empty(partial)) {
    fail_input("{}: is in the way; delete it or choose another -o", partial.string());
  }
  std::error_code error;
  fs::create_directories(marker.parent_path(), error);
  if (error) {
    fail_input("{}: cannot make this folder: {}; choose another -o", partial.string(),
               error.message());
  }
  write_below(marker, identity);
}

void move_into_place(const fs::path& partial, const fs::path& out) {
  std::error_code error;
  if (fs::exists(out)) fs::remove(out, error);  // an empty folder, see is_complete
  fs::rename(partial, out, error);
  if (error) {
    fail_run("{}: complete, but cannot be renamed to {}: {}", partial.string(), out.string(),
             error.message());
  }
}

}  // namespace

Outcome simulate(const Scene& scene, const fs::path& out, const SimulateOptions& options) {
  const std::string identity = identity_of(scene, options.format);
  if (is_complete(out, identity)) return Outcome::was_complete;
  fs::path partial = out;
  partial += ".partial";
  const InterruptGuard interrupt;
  const Stopwatch watch;
  const EventSchedule events = make_schedule(scene.config);
  const TriangleMesh mesh = make_world(scene.config.world, scene.seed());
  const RayCaster world(mesh);
  const Recording recording = simulate_sensors(scene, events, world);
  log::debug("world of {} triangles and sensors after {:.1f} s", mesh.triangles.size(),
             watch.seconds());
  open_partial(partial, identity);
  render_frames(partial, options.format, scene, events, recording, mesh, world, options.threads,
                interrupt);
  if (interrupt.interrupted()) {
    fail_run("stopped; what is done is in {}, and the same command goes on with it",
             partial.string());
  }
  write_recording(partial, options.format, scene, recording);
  write_truth(partial, scene, events, recording, mesh);
  move_into_place(partial, out);
  return Outcome::written;
}

}  // namespace apvi::sim
