// SPDX-License-Identifier: BSD-3-Clause
// Soak test of the localization threads on a long dive: checks that memory stays bounded and that
// frames do not accumulate. Images show bright points of an unbounded world; every ten minutes, 30
// s are dark.
//
//   soak [MINUTES] [CAMERA_HZ]      prints a line every five minutes of the dive
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <opencv2/core.hpp>
#include <string>

#include "core/stopwatch.hpp"
#include "localization/fusion_stage.hpp"
#include "localization/pipeline.hpp"
#include "localization/synchronizer.hpp"
#include "synthetic_dive.hpp"

namespace apvi::bench {
namespace {

constexpr Duration kReportPeriod{300'000'000'000};
constexpr double kOutagePeriod_s = 600.0;
constexpr double kOutage_s = 30.0;
constexpr double kMotionScale = 0.15;  // low, for long tracks
constexpr double kCell = 0.8;          // one point per cell [m]
constexpr int kReach = 7;              // cells around the camera
constexpr double kMinDepth = 0.8;
constexpr double kMaxDepth = 5.0;

CameraCalibration make_camera() {
  CameraCalibration camera;
  camera.model = CameraModel(CameraModel::Parameters{
      .fx = 210.0, .fy = 210.0, .cx = 159.5, .cy = 119.5, .width = 320, .height = 240});
  Eigen::Matrix3d forward;  // x right, y down, z forward, on a body with x forward, z up
  forward << 0, 0, 1, -1, 0, 0, 0, -1, 0;
  camera.T_body_camera = {Eigen::Quaterniond(forward), {0.1, 0.0, 0.05}};
  return camera;
}

std::uint32_t hash_cell(std::array<int, 3> cell) {
  std::uint32_t h = 2166136261U;
  for (const int c : cell) {
    h = (h ^ static_cast<std::uint32_t>(c)) * 16777619U;
    h ^= h >> 15U;
    h *= 2246822519U;
  }
  return h ^ (h >> 13U);
}

void draw(cv::Mat& image, const Eigen::Vector2d& at, double brightness) {
  const int x = static_cast<int>(at.x());
  const int y = static_cast<int>(at.y());
  for (int v = std::max(0, y - 3); v <= std::min(image.rows - 1, y + 3); ++v) {
    for (int u = std::max(0, x - 3); u <= std::min(image.cols - 1, x + 3); ++u) {
      const double r2 = (Eigen::Vector2d(u, v) - at).squaredNorm();
      auto& pixel = image.at<std::uint8_t>(v, u);
      pixel = cv::saturate_cast<std::uint8_t>(pixel + brightness * std::exp(-0.5 * r2));
    }
  }
}

// Renders one point per cell of space around the camera.
cv::Mat render_points(const SE3& T_world_camera, const CameraModel& model) {
  const auto& size = model.parameters();
  cv::Mat image(size.height, size.width, CV_8UC1, cv::Scalar(20));
  const SE3 T_camera_world = T_world_camera.inverse();
  const Eigen::Vector3i here = (T_world_camera.translation / kCell).array().floor().cast<int>();
  for (int n = 0; n < (2 * kReach + 1) * (2 * kReach + 1) * (2 * kReach + 1); ++n) {
    constexpr int kSide = 2 * kReach + 1;
    const Eigen::Vector3i cell =
        here + Eigen::Vector3i(n % kSide, n / kSide % kSide, n / (kSide * kSide)) -
        Eigen::Vector3i::Constant(kReach);
    const std::uint32_t h = hash_cell({cell.x(), cell.y(), cell.z()});
    const Eigen::Vector3d within(h & 255U, h >> 8U & 255U, h >> 16U & 255U);
    const Eigen::Vector3d p = T_camera_world * (kCell * (cell.cast<double>() + within / 256.0));
    if (p.z() < kMinDepth || p.z() > kMaxDepth) continue;
    const auto pixel = model.project(p);
    if (pixel && model.in_image(*pixel, 4.0)) draw(image, *pixel, 60.0 + (h >> 25U));
  }
  return image;
}

/// Frame counts; frames are output on a separate thread.
struct Count {
  std::size_t in = 0;
  std::atomic<std::size_t> out = 0;
  std::atomic<std::size_t> fused = 0;
  std::size_t max_in_flight = 0;
};

class Soak {
 public:
  Soak(double minutes, double camera_hz)
      : dive_({.imu = 100.0, .dvl = 8.0, .pressure = 10.0}, 60.0 * minutes, 1, kMotionScale),
        period_(Duration::from_seconds(1.0 / camera_hz)),
        next_image_(dive_.start() + period_) {}

  void run() {
    Rig rig = dive_.rig();
    rig.cameras.push_back(make_camera());
    localization::Options config;
    config.run.mode = localization::RunMode::replay;
    // The images have only about fifty corners; lower the threshold so that frames are fused.
    config.fusion.discriminator.tracking.min_features = 20;
    config.fusion.discriminator.degeneracy.action = fusion::DegeneracyAction::ignore;
    localization::Pipeline system(config, rig, localization::select_sensors(config, rig, {}),
                                  {.frame = [this](const localization::FrameOutput& o) {
                                    ++count_.out;
                                    if (o.fusion.state == fusion::FusionState::fused)
                                      ++count_.fused;
                                  }});
    fmt::print("| minutes of the dive | RSS, MiB | frames | fused | max in flight | wall, s |\n");
    fmt::print("|---|---|---|---|---|---|\n");
    Stamp next_report = dive_.start() + kReportPeriod;
    constexpr Duration kChunk{1'000'000'000};
    for (auto events = dive_.next(kChunk); !events.empty(); events = dive_.next(kChunk)) {
      for (const SensorEvent& event : events) feed(system, rig, event);
      if (stamp_of(events.back()) < next_report - kChunk) continue;
      report(next_report);
      next_report = next_report + kReportPeriod;
    }
    system.finish();
    fmt::print("frames: in {}, out {}, abandoned {}\n", count_.in, count_.out.load(),
               system.synchronizer().abandoned_frames());
  }

 private:
  void feed(localization::Pipeline& system, const Rig& rig, const SensorEvent& event) {
    if (std::holds_alternative<ImuSample>(event) && stamp_of(event) >= next_image_) {
      const double t = seconds_between(dive_.start(), next_image_);
      const bool dark = std::fmod(t, kOutagePeriod_s) > kOutagePeriod_s - kOutage_s;
      const CameraCalibration& camera = rig.cameras.front();
      const SE3 pose = dive_.pose_at(next_image_) * camera.T_body_camera;
      system.process(ImageFrame{next_image_, 0, [dark, pose, &camera] {
                                  return dark ? cv::Mat(240, 320, CV_8UC1, cv::Scalar(0))
                                              : render_points(pose, camera.model);
                                }});
      ++count_.in;
      next_image_ = next_image_ + period_;
    }
    system.process(event);
    count_.max_in_flight = std::max(count_.max_in_flight, count_.in - count_.out);
  }

  void report(Stamp now) {
    fmt::print("| {:.0f} | {:.1f} | {} | {} | {} | {:.0f} |\n",
               seconds_between(dive_.start(), now) / 60.0, resident_mib(), count_.out.load(),
               count_.fused.load(), count_.max_in_flight, watch_.seconds());
    std::fflush(stdout);
    count_.max_in_flight = 0;
  }

  SyntheticDive dive_;
  Duration period_;
  Stamp next_image_;
  Count count_;
  Stopwatch watch_;
};

}  // namespace
}  // namespace apvi::bench

int main(int argc, char** argv) {
  const double minutes = argc > 1 ? std::stod(argv[1]) : 60.0;
  const double camera_hz = argc > 2 ? std::stod(argv[2]) : 5.0;
  apvi::bench::Soak(minutes, camera_hz).run();
  return 0;
}
