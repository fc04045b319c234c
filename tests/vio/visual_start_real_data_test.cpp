// SPDX-License-Identifier: BSD-3-Clause
// The start of odometry by images alone on a real reef, compared with the poses of COLMAP.
#include <gtest/gtest.h>

#include <cmath>
#include <optional>
#include <variant>

#include "apvi/core/constants.hpp"
#include "apvi/geometry/so3.hpp"
#include "apvi/io/sequence.hpp"
#include "apvi/io/tum.hpp"
#include "support/test_data.hpp"
#include "vio/frontend/tracker.hpp"
#include "vio/visual/visual_odometry.hpp"

namespace apvi::vio {
namespace {

struct Reef {
  explicit Reef(const std::filesystem::path& folder)
      : truth(io::read_trajectory(folder / "colmap_poses.tum")) {
    io::DatasetConfig dataset;
    dataset.path = folder.string();
    const auto reader = io::open_sequence(dataset, {"camera"});
    rig = make_rig(reader->rig());
    const Duration late = Duration::from_seconds(rig.cameras.front().time_offset_s);
    while (const auto event = reader->next()) {
      const auto* image = std::get_if<ImageFrame>(&*event);
      if (image == nullptr) continue;
      stamps.push_back(image->stamp - late);
      images.push_back(image->decode());
    }
  }

  Rig rig;
  Trajectory truth;  // up to scale, of the camera, which is the body
  std::vector<Stamp> stamps;
  std::vector<cv::Mat> images;
};

// Angles between motions by images and by COLMAP [deg].
struct MotionError {
  double direction;
  double rotation;
};

double degrees_between(const Eigen::Vector3d& a, const Eigen::Vector3d& b) {
  return kDegreesPerRadian * std::atan2(a.cross(b).norm(), a.dot(b));
}

std::optional<MotionError> motion_error(const Trajectory& found, const Trajectory& truth,
                                        Stamp from, Stamp to) {
  const auto at = [&](const Trajectory& path) -> std::optional<SE3> {
    const auto a = path.at(from, Duration{100'000'000});
    const auto b = path.at(to, Duration{100'000'000});
    if (!a || !b) return std::nullopt;
    return a->inverse() * *b;
  };
  const auto moved = at(found);
  const auto expected = at(truth);
  if (!moved || !expected) return std::nullopt;
  return MotionError{degrees_between(moved->translation, expected->translation),
                     kDegreesPerRadian * so3::angle_between(moved->rotation, expected->rotation)};
}

// Once started, or at the end.
struct Start {
  double after_s = 0.0;
  std::optional<MotionError> error;
};

std::optional<Start> start_from(const Reef& reef, std::size_t begin) {
  Config config;
  config.window.max_solve_s = 1e3;
  Tracker tracker({}, reef.rig.cameras);
  VisualOdometry odometry(config, reef.rig);
  for (std::size_t k = begin; k < reef.images.size(); ++k) {
    const TrackedFrame frame = tracker.process({reef.images[k]}, reef.stamps[k], std::nullopt);
    const Result result = odometry.process(frame, std::nullopt);
    if (result.status != Status::started) continue;
    Trajectory path{.poses = result.earlier};
    path.merge({{result.stamp, result.state.pose()}});
    return Start{seconds_between(reef.stamps[begin], reef.stamps[k]),
                 motion_error(path, reef.truth, reef.stamps[begin], reef.stamps[k])};
  }
  return std::nullopt;
}

// Over its floor of sand another motion explains two images almost as well.
TEST(VisualStartOnRealData, HasTheDirectionOfColmapFromAnyImage) {
  APVI_NEEDS_DATA(folder, "reef_gopro");
  const Reef reef(folder);
  for (std::size_t begin = 0; begin < 165; begin += 8) {
    const auto start = start_from(reef, begin);
    ASSERT_TRUE(start) << begin;
    EXPECT_LT(start->after_s, 1.0) << begin;
    ASSERT_TRUE(start->error) << begin;
    EXPECT_LT(start->error->direction, 5.0) << begin;
    EXPECT_LT(start->error->rotation, 0.5) << begin;
  }
}

}  // namespace
}  // namespace apvi::vio
