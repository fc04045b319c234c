// SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>

#include "apvi/core/error.hpp"
#include "apvi/sensors/lens.hpp"
#include "sim/writers/csv_text.hpp"
#include "sim/writers/dataset_writer.hpp"
#include "sim/writers/formats.hpp"

// EuRoC layout as published: mav0/<sensor>/{sensor.yaml, data.csv} and mav0/body.yaml, with the
// published header lines. DVL and pressure, which EuRoC lacks, use this project's columns.
namespace apvi::sim {
namespace {

constexpr std::string_view kEurocImu =
    "#timestamp [ns],w_RS_S_x [rad s^-1],w_RS_S_y [rad s^-1],w_RS_S_z [rad s^-1],"
    "a_RS_S_x [m s^-2],a_RS_S_y [m s^-2],a_RS_S_z [m s^-2]";
constexpr std::string_view kEurocTruth =
    "#timestamp, p_RS_R_x [m], p_RS_R_y [m], p_RS_R_z [m], q_RS_w [], q_RS_x [], q_RS_y [], "
    "q_RS_z [], v_RS_R_x [m s^-1], v_RS_R_y [m s^-1], v_RS_R_z [m s^-1], b_w_RS_S_x [rad s^-1], "
    "b_w_RS_S_y [rad s^-1], b_w_RS_S_z [rad s^-1], b_a_RS_S_x [m s^-2], b_a_RS_S_y [m s^-2], "
    "b_a_RS_S_z [m s^-2]";

std::string numbers(const auto& values) {
  std::string text;
  for (const double value : values)
    text += fmt::format("{}{:.12g}", text.empty() ? "" : ", ", value);
  return text;
}

std::string sensor_head(std::string_view type, std::string_view comment, const SE3& T_body_sensor) {
  const Eigen::Matrix<double, 4, 4, Eigen::RowMajor> m = T_body_sensor.matrix();
  const std::vector<double> data(m.data(), m.data() + m.size());
  return fmt::format("sensor_type: {}\ncomment: {}\nT_BS:\n  cols: 4\n  rows: 4\n  data: [{}]\n",
                     type, comment, numbers(data));
}

std::string camera_yaml(const CameraCalibration& camera) {
  const CameraModel::Parameters& p = camera.model.parameters();
  const bool fisheye = p.distortion == Distortion::equidistant;
  const bool plain = p.distortion == Distortion::none;
  if (!fisheye && !plain && p.distortion != Distortion::radtan) {
    fail_input("rig: EuRoC has no name for the lens {}; use another format",
               lens_name(p.distortion));
  }
  const std::vector<double> k = plain ? std::vector<double>(4, 0.0) : coefficients_of(p);
  return sensor_head("camera", "simulated camera", camera.T_body_camera) +
         fmt::format(
             "rate_hz: {}\nresolution: [{}, {}]\ncamera_model: pinhole\n"
             "intrinsics: [{}]\ndistortion_model: {}\ndistortion_coefficients: [{}]\n",
             camera.rate_hz, p.width, p.height, numbers(std::array{p.fx, p.fy, p.cx, p.cy}),
             fisheye ? "equidistant" : "radial-tangential", numbers(k));
}

std::string imu_yaml(const ImuCalibration& imu) {
  return sensor_head("imu", "simulated IMU", SE3::identity()) +
         fmt::format(
             "rate_hz: {}\ngyroscope_noise_density: {:.9g}\ngyroscope_random_walk: {:.9g}\n"
             "accelerometer_noise_density: {:.9g}\naccelerometer_random_walk: {:.9g}\n",
             imu.rate_hz, imu.gyro_noise_density, imu.gyro_random_walk, imu.accel_noise_density,
             imu.accel_random_walk);
}

}  // namespace

void write_euroc(const std::filesystem::path& root, const Scene& scene,
                 const Recording& recording) {
  const std::filesystem::path mav = root / "mav0";
  const Rig rig = make_rig(perturbed_rig(scene));
  write_file(mav / "body.yaml", "comment: simulated underwater vehicle\n");
  if (rig.imu) {
    write_file(mav / "imu0" / "sensor.yaml", imu_yaml(*rig.imu));
    write_file(mav / "imu0" / "data.csv", imu_csv(recording.imu.samples, kEurocImu));
  }
  for (std::size_t i = 0; i < rig.cameras.size(); ++i) {
    const std::filesystem::path camera = mav / fmt::format("cam{}", i);
    write_file(camera / "sensor.yaml", camera_yaml(rig.cameras[i]));
    write_file(camera / "data.csv", camera_csv(recording.frames, "#timestamp [ns],filename",
                                               image_extension(scene.config)));
  }
  if (rig.dvl) {
    write_file(mav / "dvl0" / "sensor.yaml",
               sensor_head("dvl", "simulated DVL", rig.dvl->T_body_dvl));
    write_file(mav / "dvl0" / "data.csv", dvl_csv(recording.dvl));
  }
  if (rig.pressure) {
    const SE3 port{Eigen::Quaterniond::Identity(), rig.pressure->p_body_sensor};
    write_file(mav / "pressure0" / "sensor.yaml", sensor_head("pressure", "simulated", port));
    write_file(mav / "pressure0" / "data.csv", pressure_csv(recording.pressure));
  }
  const std::filesystem::path truth = mav / "state_groundtruth_estimate0";
  write_file(truth / "sensor.yaml",
             sensor_head("visual-inertial", "ground truth", SE3::identity()));
  write_file(truth / "data.csv", truth_csv(recording.imu, kEurocTruth));
}

}  // namespace apvi::sim
