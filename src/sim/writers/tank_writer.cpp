// SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>

#include <iterator>

#include "sim/writers/formats.hpp"

// Raw folder of the Tank dataset, with the columns written by its bag2raw.py. It stores heights
// instead of pressures and no DVL validity, so invalid pings are omitted.
namespace apvi::sim {
namespace {

template <typename... Args>
void append(std::string& csv, fmt::format_string<Args...> format, Args&&... args) {
  fmt::format_to(std::back_inserter(csv), format, std::forward<Args>(args)...);
}

std::string tank_imu(const std::vector<ImuSample>& samples) {
  std::string csv = "timestamp[ns],wx,wy,wz,ax,ay,az\n";
  for (const ImuSample& s : samples) {
    append(csv, "{},{:.9g},{:.9g},{:.9g},{:.9g},{:.9g},{:.9g}\n", s.stamp.ns, s.gyro.x(),
           s.gyro.y(), s.gyro.z(), s.accel.x(), s.accel.y(), s.accel.z());
  }
  return csv;
}

std::string tank_dvl(const std::vector<DvlSample>& samples) {
  std::string csv = "timestamp[ns],vx,vy,vz,b1,b2,b3,b4\n";
  for (const DvlSample& s : samples) {
    if (!s.valid) continue;
    append(csv, "{},{:.9g},{:.9g},{:.9g}", s.stamp.ns, s.velocity.x(), s.velocity.y(),
           s.velocity.z());
    for (const auto& beam : s.beams) append(csv, ",{:.9g}", beam->velocity);
    csv += '\n';
  }
  return csv;
}

std::string tank_depth(const std::vector<PressureDepthSample>& samples) {
  std::string csv = "timestamp[ns],pos_z[m]\n";
  for (const PressureDepthSample& s : samples) append(csv, "{},{:.9g}\n", s.stamp.ns, -s.depth_m);
  return csv;
}

std::string tank_truth(const ImuRecord& record) {
  std::string csv = "timestamp[ns],x,y,z,qx,qy,qz,qw\n";
  for (std::size_t i = 0; i < record.samples.size(); ++i) {
    const SE3& pose = record.truth[i].T_world_body;
    append(csv, "{},{:.9f},{:.9f},{:.9f},{:.9f},{:.9f},{:.9f},{:.9f}\n", record.samples[i].stamp.ns,
           pose.translation.x(), pose.translation.y(), pose.translation.z(), pose.rotation.x(),
           pose.rotation.y(), pose.rotation.z(), pose.rotation.w());
  }
  return csv;
}

}  // namespace

config::Node rig_with_depth(const Scene& scene) {
  config::Node rig = perturbed_rig(scene);
  if (const config::Node* pressure = rig.find("pressure0")) {
    config::Node depth;
    for (const char* key : {"p_body_sensor", "noise_m"}) {
      if (const config::Node* value = pressure->find(key)) depth.member(key) = *value;
    }
    rig.member("depth0") = depth;
    std::erase_if(rig.members, [](const auto& member) { return member.first == "pressure0"; });
  }
  return rig;
}

std::vector<PressureDepthSample> depth_samples(const Scene& scene, const Recording& recording) {
  std::vector<PressureDepthSample> samples = recording.depth;
  for (const PressureSample& s : recording.pressure) {
    samples.push_back({s.stamp, scene.rig.pressure->depth(s.pressure_pa)});
  }
  return samples;
}

void write_tank(const std::filesystem::path& root, const Scene& scene, const Recording& recording) {
  write_file(root / "rig.yaml", config::to_yaml(rig_with_depth(scene)) + "\n");
  if (scene.rig.imu) write_file(root / "imu.csv", tank_imu(recording.imu.samples));
  if (scene.rig.dvl) write_file(root / "dvl.csv", tank_dvl(recording.dvl));
  if (scene.rig.pressure || scene.rig.depth) {
    write_file(root / "depth.csv", tank_depth(depth_samples(scene, recording)));
  }
  write_file(root / "gt.csv", tank_truth(recording.imu));
}

}  // namespace apvi::sim
