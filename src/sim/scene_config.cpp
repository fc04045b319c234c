// SPDX-License-Identifier: BSD-3-Clause
#include "sim/scene_config.hpp"

#include <fmt/format.h>

#include <array>
#include <numbers>
#include <vector>

#include "apvi/core/error.hpp"
#include "apvi/geometry/so3.hpp"
#include "apvi/io/rig_file.hpp"
#include "config/renamed_keys.hpp"
#include "core/random.hpp"
#include "sim/spectral/water_optics.hpp"

namespace apvi::sim {
namespace {

namespace fs = std::filesystem;
using config::Node;

constexpr std::uint64_t kRigErrorStream = 51;
constexpr double kAssumedSoundSpeed = 1500.0;  // by the A50 [m/s]

// A small survey vehicle. Body forward-left-up; the camera looks forward and 25 degrees down, the
// DVL (forward-right-down) straight down.
constexpr const char* kDefaultRig = R"(
body: imu0
world: up
cam0:
  model: pinhole
  intrinsics: [420.0, 420.0, 319.5, 239.5]
  distortion: radtan
  coefficients: [-0.11, 0.035, 0.0004, -0.0003]
  resolution: [640, 480]
  rate_hz: 20
  T_body_sensor: [0, -0.42261826, 0.90630779, 0.18, -1, 0, 0, 0, 0, -0.90630779, -0.42261826, -0.03, 0, 0, 0, 1]
  time_offset_s: 0.0
dvl0:
  T_body_sensor: [1, 0, 0, -0.12, 0, -1, 0, 0.03, 0, 0, -1, -0.14, 0, 0, 0, 1]
  time_offset_s: 0.1
pressure0: {p_body_sensor: [-0.05, 0.06, 0.08], water_density: 1025.0, gravity: 9.80665, atmospheric_pressure_pa: 101325}
)";

Node number_node(double value) {
  Node node;
  node.kind = Node::Kind::scalar;
  node.text = fmt::format("{:.10g}", value);
  return node;
}

// Resolves a file name relative to the configuration file that contains it.
std::string resolve_relative(const Node& node) {
  const fs::path name = node.text;
  if (name.is_absolute() || !node.source || node.line == 0) return node.text;
  const fs::path candidate = fs::path(*node.source).parent_path() / name;
  return fs::exists(candidate) || !fs::exists(name) ? candidate.string() : node.text;
}

void resolve_file_names(Node& root) {
  if (root.find("motion") == nullptr) return;
  Node& motion = root.member("motion");
  if (const Node* file = motion.find("file"); file != nullptr && !file->text.empty()) {
    const std::string name = resolve_relative(*file);
    motion.member("file").text = name;
  }
}

Node load_rig(const Node& given) {
  if (given.kind == Node::Kind::scalar) return io::load_rig_file(resolve_relative(given));
  Node rig = config::parse_yaml(kDefaultRig, "built-in rig");
  if (!given.is_null()) config::merge(rig, given);
  return rig;
}

// The true rig: noise parameters and DVL scale are those of the simulated sensors.
Node true_rig(const SceneConfig& scene) {
  Node rig = load_rig(scene.rig);
  constexpr double kMinNoise = 1e-9;  // a rig file requires positive noise
  if (scene.imu.enabled) {
    Node& imu = rig.member("imu0");
    imu.member("rate_hz") = number_node(scene.imu.rate_hz);
    imu.member("gyro_noise_density") =
        number_node(std::max(scene.imu.gyro_noise_density, kMinNoise));
    imu.member("gyro_random_walk") = number_node(scene.imu.gyro_random_walk);
    imu.member("accel_noise_density") =
        number_node(std::max(scene.imu.accel_noise_density, kMinNoise));
    imu.member("accel_random_walk") = number_node(scene.imu.accel_random_walk);
  }
  if (rig.find("dvl0") != nullptr && scene.dvl.enabled) {
    Node& dvl = rig.member("dvl0");
    const double noise =
        std::hypot(scene.dvl.noise_floor, scene.dvl.noise_per_speed * scene.motion.speed_m_s);
    dvl.member("velocity_noise") = number_node(std::max(noise, 1e-5));
    dvl.member("sound_speed") = number_node(kAssumedSoundSpeed / (1.0 + scene.dvl.scale_error));
    dvl.member("assumed_sound_speed") = number_node(kAssumedSoundSpeed);
  }
  for (const char* name : {"pressure0", "depth0"}) {
    if (rig.find(name) != nullptr && scene.pressure.enabled) {
      rig.member(name).member("noise_m") = number_node(std::max(scene.pressure.noise_m, 1e-5));
    }
  }
  return rig;
}

Node pose_node(const SE3& pose) {
  Node node;
  node.kind = Node::Kind::list;
  const Eigen::Matrix4d m = pose.matrix();
  for (int row = 0; row < 4; ++row) {
    for (int column = 0; column < 4; ++column) node.items.push_back(number_node(m(row, column)));
  }
  return node;
}

struct RigLamp {
  SE3 T_camera_lamp;
  double half_beam_deg = 0.0;
  double intensity = 1.0;
};

std::vector<RigLamp> lamps_of(const SceneConfig& scene) {
  using Eigen::Vector3d;
  const auto vector = [](const std::array<double, 3>& v) { return Vector3d(v[0], v[1], v[2]); };
  if (scene.physics == Physics::paper) {
    if (!scene.light.lamp) return {};
    return {
        {.T_camera_lamp = {Eigen::Quaterniond::Identity(), vector(scene.light.lamp->position_m)},
         .half_beam_deg = scene.light.lamp->half_beam_deg}};
  }
  std::vector<RigLamp> lamps;
  for (const SpectralLampConfig& lamp : scene.spectral.lamps) {
    const auto R = Eigen::Quaterniond::FromTwoVectors(Vector3d::UnitZ(), vector(lamp.aim));
    lamps.push_back({.T_camera_lamp = {R, vector(lamp.position_m)},
                     .half_beam_deg = lamp.half_beam_deg,
                     .intensity = lamp.intensity});
  }
  return lamps;
}

// Adds the poses, beam angles and intensities of the lamps to the rig.
void add_lamps(const SceneConfig& scene, const Rig& rig, Node& node) {
  if (rig.cameras.empty()) return;
  const std::vector<RigLamp> lamps = lamps_of(scene);
  for (std::size_t i = 0; i < lamps.size(); ++i) {
    Node& section = node.member(fmt::format("lamp{}", i));
    section.member("T_body_sensor") =
        pose_node(rig.cameras.front().T_body_camera * lamps[i].T_camera_lamp);
    section.member("half_beam_deg") = number_node(lamps[i].half_beam_deg);
    if (lamps.size() > 1) section.member("intensity") = number_node(lamps[i].intensity);
  }
}

// Keys that the chosen physics does not have.
void check_physics(const SceneConfig& scene) {
  if (scene.physics == Physics::paper) {
    if (!scene.spectral.lamps.empty())
      fail_input("spectral.lamps: only physics: spectral has them; use light.lamp");
    return;
  }
  const WaterConfig& water = scene.water;
  if (scene.light.lamp) fail_input("light.lamp: physics: spectral has spectral.lamps instead");
  if (water.beta_d || water.beta_b || water.b_inf)
    fail_input("water.beta_d, beta_b and b_inf: only physics: paper has them");
  if (scene.spectral.lamps.size() > 2) fail_input("spectral.lamps: at most two");
  for (const SpectralLampConfig& lamp : scene.spectral.lamps)
    if (lamp.aim[0] == 0.0 && lamp.aim[1] == 0.0 && lamp.aim[2] == 0.0)
      fail_input("spectral.lamps: aim must not be zero");
}

void drop_disabled(const SceneConfig& scene, Node& rig) {
  std::erase_if(rig.members, [&](const auto& member) {
    const std::string& name = member.first;
    return (name == "dvl0" && !scene.dvl.enabled) || (name == "imu0" && !scene.imu.enabled) ||
           ((name == "pressure0" || name == "depth0") && !scene.pressure.enabled);
  });
}

Eigen::Vector3d normal3(Random& random) {
  const double x = random.normal();
  const double y = random.normal();
  return {x, y, random.normal()};
}

SE3 perturbed(const SE3& pose, const RigErrorConfig& error, Random& random) {
  const double angle = error.rotation_deg * std::numbers::pi / 180.0;
  const Eigen::Vector3d turn = angle * normal3(random);
  const Eigen::Vector3d shift = error.translation_m * normal3(random);
  return {(pose.rotation * so3::exp(turn)).normalized(), pose.translation + shift};
}

}  // namespace

Node perturbed_rig(const Scene& scene) {
  const RigErrorConfig& error = scene.config.rig_error;
  Random random = Random(scene.sensor_seed()).fork(kRigErrorStream);
  Node rig = scene.rig_node;
  for (std::size_t i = 0; i < scene.rig.cameras.size(); ++i) {
    Node& camera = rig.member(fmt::format("cam{}", i));
    const SE3 pose = perturbed(scene.rig.cameras[i].T_body_lens(), error, random);
    const double focal = 1.0 + 0.01 * error.focal_percent * random.normal();
    if (error.rotation_deg + error.translation_m > 0.0)
      camera.member("T_body_sensor") = pose_node(pose);
    if (error.focal_percent == 0.0) continue;
    const CameraModel::Parameters& p = scene.rig.cameras[i].lens().parameters();
    camera.member("intrinsics").items[0] = number_node(p.fx * focal);
    camera.member("intrinsics").items[1] = number_node(p.fy * focal);
  }
  if (scene.rig.dvl) {
    Node& dvl = rig.member("dvl0");
    const SE3 pose = perturbed(scene.rig.dvl->T_body_dvl, error, random);
    if (error.rotation_deg + error.translation_m > 0.0)
      dvl.member("T_body_sensor") = pose_node(pose);
    if (error.hide_dvl_latency) dvl.member("time_offset_s") = number_node(0.0);
    if (error.hide_dvl_scale) dvl.member("sound_speed") = number_node(kAssumedSoundSpeed);
  }
  if (scene.rig.pressure && error.translation_m > 0.0) {
    const Eigen::Vector3d p =
        scene.rig.pressure->p_body_sensor + error.translation_m * normal3(random);
    Node& arm = rig.member("pressure0").member("p_body_sensor");
    arm = pose_node({});
    arm.items = {number_node(p.x()), number_node(p.y()), number_node(p.z())};
  }
  return rig;
}

EventSchedule make_schedule(const SceneConfig& scene) {
  const WaterConfig& water = scene.water;
  const double green = scene.physics == Physics::paper
                           ? make_medium(water).beta_d.y()
                           : beam_at_green(make_optics(water.type, water.attenuation_length_m));
  return EventSchedule(scene.events, scene.duration_s, 1.0 / std::max(green, 1e-3));
}

Scene make_scene(const Node& node) {
  Node root = node;
  resolve_file_names(root);
  Scene scene;
  config::read(root, scene.config);
  check_physics(scene.config);
  check_objects(scene.config.world);
  check_fish(scene.config.world);
  scene.rig_node = true_rig(scene.config);
  drop_disabled(scene.config, scene.rig_node);
  add_lamps(scene.config, make_rig(scene.rig_node), scene.rig_node);
  scene.rig = make_rig(scene.rig_node);
  if (scene.rig.world != WorldFrame::up) {
    fail_input("rig.world: the simulator requires z up; remove `world: ned`");
  }
  if (!scene.config.camera.enabled) {
    std::erase_if(scene.rig_node.members, [](const auto& m) { return m.first.starts_with("cam"); });
    scene.rig.cameras.clear();
  }
  make_schedule(scene.config);  // reports errors before the world is built
  return scene;
}

std::string scene_documentation() {
  return config::to_markdown(config::document(SceneConfig{}));
}

Scene load_scene(const fs::path& path, const std::vector<std::string>& overrides,
                 const std::vector<fs::path>& search) {
  return make_scene(config::load_config(path, overrides, config::scene_renames(), search));
}

}  // namespace apvi::sim
