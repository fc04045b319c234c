// SPDX-License-Identifier: BSD-3-Clause
#include "doctor/camera_view.hpp"

#include <algorithm>
#include <cmath>

#include "apvi/core/constants.hpp"
#include "apvi/geometry/so3.hpp"

namespace apvi::doctor {
namespace {

using Eigen::Quaterniond;
using Eigen::Vector3d;

constexpr double kMaxPingAge = 0.3;  // [s]
constexpr double kMinSpeed = 0.05;   // [m/s]
constexpr double kAlong = 0.5;       // cosine between directions that can be compared
constexpr std::size_t kMinPairs = 15;
constexpr double kAgreement = 0.85;  // of the pairs
constexpr double kNear = 30.0 * kRadiansPerDegree;

std::optional<Vector3d> velocity_at(const std::vector<DvlPing>& pings, Stamp stamp) {
  const auto off = [stamp](const DvlPing& ping) {
    return std::abs(seconds_between(stamp, ping.stamp));
  };
  const auto nearest = std::min_element(
      pings.begin(), pings.end(), [&](const auto& a, const auto& b) { return off(a) < off(b); });
  if (nearest == pings.end() || off(*nearest) > kMaxPingAge) return std::nullopt;
  if (nearest->velocity.norm() < kMinSpeed) return std::nullopt;
  return nearest->velocity;
}

struct Votes {
  std::size_t with = 0;
  std::size_t against = 0;
};

// Whether the camera moves along or against the DVL's velocity, as the model turns it.
Votes compare_with_dvl(const std::vector<DvlPing>& pings, const DvlMounting& mounting,
                       const CameraGyroProblem& problem, const CameraGyroModel& model,
                       double noise_px) {
  Votes votes;
  for (std::size_t i = 0; i < problem.pairs().size(); ++i) {
    const Stamp before = problem.pairs()[i].before;
    const double half = 0.5 * seconds_between(before, problem.pairs()[i].now);
    const auto velocity =
        velocity_at(pings, before + Duration::from_seconds(half - model.time_offset_s));
    const auto direction = problem.direction(model, noise_px, i);
    if (!velocity || !direction) continue;
    const Vector3d expected = model.R_camera_body * (mounting.matrix * *velocity).normalized();
    const double cosine = expected.dot(*direction);
    if (cosine > kAlong) ++votes.with;
    if (cosine < -kAlong) ++votes.against;
  }
  return votes;
}

Mirror mirror_of(const CameraGyroModel& model, const CameraGyroModel& rig, std::size_t pairs) {
  const auto flipped = [&](const char* name, const Vector3d& axis) {
    const Quaterniond half_turn(0.0, axis.x(), axis.y(), axis.z());
    return Mirror{name, half_turn * model.R_camera_body, pairs};
  };
  const Mirror left = flipped("left to right", Vector3d::UnitX());
  const Mirror top = flipped("top to bottom", Vector3d::UnitY());
  const auto off = [&](const Mirror& mirror) {
    return so3::angle_between(mirror.R_camera_body, rig.R_camera_body);
  };
  return off(left) < off(top) ? left : top;
}

}  // namespace

std::optional<Mirror> find_mirror(const std::vector<DvlPing>& pings, const DvlMounting& mounting,
                                  const CameraGyroProblem& problem, const CameraGyroModel& model,
                                  const CameraGyroModel& rig, double noise_px) {
  const Votes votes = compare_with_dvl(pings, mounting, problem, model, noise_px);
  const auto all = static_cast<double>(votes.with + votes.against);
  const bool decided = votes.with + votes.against >= kMinPairs &&
                       static_cast<double>(std::max(votes.with, votes.against)) >= kAgreement * all;
  if (decided) {
    if (votes.with > votes.against) return std::nullopt;
    return mirror_of(model, rig, votes.against);
  }
  const Mirror mirror = mirror_of(model, rig, 0);
  if (so3::angle_between(mirror.R_camera_body, rig.R_camera_body) > kNear) return std::nullopt;
  return mirror;
}

double lens_shift_px(const CameraModel& camera, double radial) {
  const CameraModel::Parameters& p = camera.parameters();
  const double r =
      std::hypot(std::max(p.cx, p.width - p.cx) / p.fx, std::max(p.cy, p.height - p.cy) / p.fy);
  // Of k r³, a change of the focal length takes the part that is linear in r: most of it in the
  // inner image. What remains at the corner is about half.
  return 0.5 * std::abs(radial) * r * r * r * p.fx;
}

}  // namespace apvi::doctor
