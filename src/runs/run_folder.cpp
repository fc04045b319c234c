// SPDX-License-Identifier: BSD-3-Clause
#include "runs/run_folder.hpp"

#include <fmt/format.h>

#include <cmath>
#include <system_error>

#include "apvi/core/constants.hpp"
#include "apvi/core/error.hpp"
#include "apvi/geometry/so3.hpp"
#include "apvi/io/tum.hpp"
#include "runs/dive_files.hpp"

namespace apvi::runs {
namespace {

namespace fs = std::filesystem;

constexpr const char* kCalibrationHeader =
    "#timestamp [ns],dvl_time_offset [s],dvl_time_offset_sigma [s],dvl_scale_error,"
    "dvl_scale_error_sigma,mounting_x [rad],mounting_y [rad],mounting_z [rad],mounting_sigma [rad],"
    "lever_x [m],lever_y [m],lever_z [m],lever_sigma [m],depth_bias [m],depth_bias_sigma [m],"
    "gyro_bias_x [rad s^-1],gyro_bias_y [rad s^-1],gyro_bias_z [rad s^-1],gyro_bias_sigma [rad "
    "s^-1],"
    "accel_bias_x [m s^-2],accel_bias_y [m s^-2],accel_bias_z [m s^-2],accel_bias_sigma [m s^-2]\n";
constexpr const char* kPingHeader =
    "#timestamp "
    "[ns],verdict,nis,degrees_of_freedom,accel_noise_factor,dvl_variance_factor,position_sigma [m],"
    "rotation_sigma [deg],velocity_sigma [m s^-1]\n";

constexpr const char* kHealthHeader =
    "#timestamp [ns],state,level,reason,measured,threshold,vio,tracked,detected,stable,spread,"
    "brightness,landmarks,observations,reprojection [px],rotation_eigenvalue_1 [rad^-2],"
    "rotation_eigenvalue_2 [rad^-2],rotation_eigenvalue_3 [rad^-2],position_eigenvalue_1 [m^-2],"
    "position_eigenvalue_2 [m^-2],position_eigenvalue_3 "
    "[m^-2],dipo,dipo_measured,phase,action,window "
    "[s]\n";
constexpr const char* kTimingHeader =
    "#timestamp [ns],decode [s],track [s],solve [s],information [s],marginalize [s],localize [s],"
    "dropped\n";

// Standard deviation of a covariance block, per axis.
double sigma(const dipo::Matrix& P, int index, int count) {
  return std::sqrt(std::max(0.0, P.diagonal().segment(index, count).mean()));
}

std::string calibration_line(const dipo::Estimate& e) {
  const dipo::State& x = e.state;
  const dipo::Matrix& P = e.covariance;
  const Eigen::Vector3d m = so3::log(x.R_body_dvl);
  const Eigen::Vector3d& l = x.p_body_dvl;
  const Eigen::Vector3d& g = x.nav.gyro_bias;
  const Eigen::Vector3d& a = x.nav.accel_bias;
  return fmt::format(
      "{},{:.6f},{:.6f},{:.6f},{:.6f},{:.6f},{:.6f},{:.6f},{:.6f},{:.4f},{:.4f},{:.4f},{:.4f},"
      "{:.4f},{:.4f},{:.4e},{:.4e},{:.4e},{:.4e},{:.4e},{:.4e},{:.4e},{:.4e}\n",
      e.stamp.ns, x.dvl_time_offset_s, sigma(P, dipo::kTimeOffset, 1), x.dvl_scale_error,
      sigma(P, dipo::kScale, 1), m.x(), m.y(), m.z(), sigma(P, dipo::kMounting, 3), l.x(), l.y(),
      l.z(), sigma(P, dipo::kLeverArm, 3), x.depth_bias_m, sigma(P, dipo::kDepthBias, 1), g.x(),
      g.y(), g.z(), sigma(P, imu::kGyroBias, 3), a.x(), a.y(), a.z(), sigma(P, imu::kAccelBias, 3));
}

std::string ping_line(const localization::PingOutput& output) {
  dipo::Matrix P = output.estimate.covariance;
  P.topLeftCorner<6, 6>() += output.estimate.segment_covariance;
  const dipo::Report& ping = output.ping;
  return fmt::format("{},{},{:.4f},{},{:.3f},{:.3f},{:.5f},{:.5f},{:.5f}\n",
                     output.estimate.stamp.ns, dipo::to_string(ping.verdict), ping.nis, ping.rows,
                     ping.accel_factor, ping.dvl_variance_factor, sigma(P, imu::kPosition, 3),
                     kDegreesPerRadian * sigma(P, imu::kTheta, 3), sigma(P, imu::kVelocity, 3));
}

std::string frame_line(const localization::FrameOutput& o) {
  const vio::FrameStatistics& statistics = o.statistics;
  const fusion::FusionResult& f = o.fusion;
  const fusion::Eigenvalues e = f.eigenvalues.value_or(fusion::Eigenvalues{});
  return fmt::format(
      "{},{},{},{},{:.4g},{:.4g},{},{},{},{},{:.3f},{:.1f},{},{},{:.3f},{:.4g},{:.4g},{:.4g},{:.4g}"
      ","
      "{:.4g},{:.4g},{},{:.4g},{},{},{:.3f}\n",
      o.stamp.ns, o.pose_source(), fusion::to_string(f.verdict.level),
      fusion::to_string(f.verdict.reason), f.verdict.measured, f.verdict.threshold,
      vio::to_string(o.vio.status), statistics.tracked, statistics.detected, statistics.stable,
      statistics.spread, statistics.brightness, o.vio.landmarks, o.vio.observations,
      o.vio.reprojection_rms_px, e.rotation[0], e.rotation[1], e.rotation[2], e.position[0],
      e.position[1], e.position[2], fusion::to_string(f.dipo.reason), f.dipo.measured,
      fusion::to_string(f.freeze.phase), fusion::to_string(f.freeze.action), o.vio.window_s);
}

std::string timing_line(const localization::FrameOutput& o) {
  const localization::FrameTiming& t = o.timing;
  return fmt::format("{},{:.6f},{:.6f},{:.6f},{:.6f},{:.6f},{:.6f},{}\n", o.stamp.ns, t.decode_s,
                     t.track_s, t.solve_s, t.information_s, t.marginalize_s, t.localize_s,
                     o.dropped ? 1 : 0);
}

std::ofstream open_file(const fs::path& path, const char* header) {
  std::ofstream out(path, std::ios::binary);
  out << header;
  if (!out) fail_run("{}: cannot be written", path.string());
  return out;
}

}  // namespace

void check_vacant(const fs::path& path, bool overwrite) {
  if (fs::exists(path) && !fs::is_directory(path)) {
    fail_input("{}: is a file; expected a folder", path.string());
  }
  const bool occupied = fs::exists(path / "trajectory.tum") || fs::exists(path / "map.ply");
  if (occupied && !overwrite) {
    fail_input("{}: already holds a run; choose another folder with -o, or use --overwrite",
               path.string());
  }
}

void prepare_folder(const fs::path& path, bool overwrite) {
  check_vacant(path, overwrite);
  std::error_code error;
  fs::create_directories(path, error);
  if (error) fail_run("{}: cannot create folder: {}", path.string(), error.message());
  for (const char* stale :
       {"metrics.json", "report.html", "trajectory_smoothed.tum", "places.bin", "vio.tum",
        "keyframes.tum", "health.csv", "timing.csv", "rig_estimated.yaml", "mapping.csv",
        kCheckpointFile, "map.ply", "medium.json", kSensorsFile, kLoopsFile}) {
    fs::remove(path / stale, error);
  }
  for (const char* stale : {"renders", kStorageFolder}) fs::remove_all(path / stale, error);
}

void copy_files(const fs::path& from, const fs::path& to, std::span<const char* const> names) {
  for (const char* name : names) {
    if (!fs::exists(from / name)) continue;
    std::error_code error;
    fs::copy_file(from / name, to / name, fs::copy_options::overwrite_existing, error);
    if (error) fail_run("{}: {}", (to / name).string(), error.message());
  }
}

RunFolder::RunFolder(const fs::path& path, const RunFolderOptions& options)
    : path_(path), camera_(options.camera) {
  prepare_folder(path, options.overwrite);
  trajectory_ = open_file(file("trajectory.tum"), "");
  dipo_ = open_file(file("dipo.tum"), "");
  calibration_ = open_file(file("calibration.csv"), kCalibrationHeader);
  pings_ = open_file(file("pings.csv"), kPingHeader);
  if (!options.camera) return;
  vio_ = open_file(file("vio.tum"), "");
  keyframes_ = open_file(file("keyframes.tum"), "");
  health_ = open_file(file("health.csv"), kHealthHeader);
  timing_ = open_file(file("timing.csv"), kTimingHeader);
}

void RunFolder::write(const localization::PingOutput& output) {
  const imu::NavState& nav = output.estimate.state.nav;
  const std::string line = io::tum_line({output.estimate.stamp, nav.pose()});
  if (!camera_) trajectory_ << line;
  dipo_ << line;
  calibration_ << calibration_line(output.estimate);
  pings_ << ping_line(output);
  for (const std::ofstream* out : {&dipo_, &calibration_, &pings_}) check(*out);
}

// Changes the poses written so far.
void RunFolder::rewrite(std::ofstream& out, const std::string& name,
                        const localization::FrameOutput& output) const {
  out.close();
  check(out);
  Trajectory poses;
  if (fs::file_size(file(name)) > 0) poses = io::read_trajectory(file(name));
  if (output.scale_found) localization::apply(*output.scale_found, poses);
  if (&out != &keyframes_) poses.merge(output.vio.earlier);
  out = open_file(file(name), "");
  for (const StampedPose& pose : poses.poses) out << io::tum_line(pose);
}

void RunFolder::write(const localization::FrameOutput& output) {
  if (output.scale_found || !output.vio.earlier.empty()) {
    rewrite(trajectory_, "trajectory.tum", output);
    rewrite(vio_, "vio.tum", output);
    rewrite(keyframes_, "keyframes.tum", output);
  }
  if (const auto pose = output.fused()) trajectory_ << io::tum_line(*pose);
  if (output.vio.has_state()) {
    const imu::NavState& nav = output.vio.state;
    const std::string line = io::tum_line({output.stamp, nav.pose()});
    vio_ << line;
    if (output.vio.keyframe) keyframes_ << line;
  }
  health_ << frame_line(output);
  timing_ << timing_line(output);
  for (const std::ofstream* out : {&trajectory_, &vio_, &health_, &timing_}) check(*out);
}

void RunFolder::close() {
  for (std::ofstream* out :
       {&trajectory_, &dipo_, &calibration_, &pings_, &vio_, &keyframes_, &health_, &timing_}) {
    if (!out->is_open()) continue;
    out->flush();
    check(*out);
  }
}

void RunFolder::check(const std::ofstream& out) const {
  if (!out) fail_run("{}: write failed; is the disk full?", path_.string());
}

}  // namespace apvi::runs
