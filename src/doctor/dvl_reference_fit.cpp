// SPDX-License-Identifier: BSD-3-Clause
#include "doctor/dvl_reference_fit.hpp"

#include <Eigen/Cholesky>
#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>

#include "apvi/geometry/so3.hpp"
#include "core/median.hpp"
#include "doctor/scan.hpp"

namespace apvi::doctor {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

constexpr double kStep = 0.05;            // of the integration [s]
constexpr double kMinOverlap = 120.0;     // of reference and sensors [s]
constexpr double kReferenceStep = 0.5;    // minimum spacing of reference poses [s]
constexpr double kMaxReferenceGap = 3.0;  // [s]
constexpr std::array<double, 3> kBaselines = {30.0, 60.0, 100.0};  // [s]
constexpr int kGroups = 5;
constexpr int kUnknowns = 5;  // yaw, scale - 1, lever arm
using Row = Eigen::Matrix<double, 1, kUnknowns>;
using Matrix = Eigen::Matrix<double, kUnknowns, kUnknowns>;
using Vector = Eigen::Matrix<double, kUnknowns, 1>;
// Prior information on the lever arm: weak when it is estimated, strong when it is fixed.
constexpr double kFreeInformation = 1e-4;
constexpr double kFixedInformation = 1e9;

struct Knot {
  double t = 0.0;
  Eigen::Quaterniond R_world_start;  // from the gyro's to the reference's attitude
  Vector3d position;
};

std::vector<Knot> knots_of(const InertialPath& path, const Trajectory& reference) {
  std::vector<Knot> knots;
  for (const StampedPose& pose : reference.poses) {
    const double t = path.seconds(pose.stamp);
    if (!knots.empty() && t - knots.back().t < kReferenceStep) continue;
    const auto state = path.at(t);
    if (!state) continue;
    Eigen::Quaterniond correction = pose.T_world_body.rotation * state->R_start_body.conjugate();
    knots.push_back({t, correction.normalized(), pose.T_world_body.translation});
  }
  return knots;
}

// Time grid of the integration, with attitudes.
struct Grid {
  std::vector<double> t;
  std::vector<Matrix3d> R_world_body;
  std::vector<bool> valid;         // attitude available
  std::vector<std::size_t> knots;  // index of the first grid time at or after each knot
};

Grid grid_of(const InertialPath& path, const std::vector<Knot>& knots) {
  Grid grid;
  for (std::size_t k = 0; k + 1 < knots.size(); ++k) {
    const double span = knots[k + 1].t - knots[k].t;
    const int n = std::max(1, static_cast<int>(std::lround(std::min(span, 1e3) / kStep)));
    grid.knots.push_back(grid.t.size());
    for (int i = 0; i < n; ++i) {
      const double u = static_cast<double>(i) / n;
      const double t = knots[k].t + u * span;
      const auto state = path.at(t);
      const Eigen::Quaterniond correction =
          knots[k].R_world_start.slerp(u, knots[k + 1].R_world_start);
      grid.t.push_back(t);
      grid.valid.push_back(state.has_value() && span < kMaxReferenceGap);
      grid.R_world_body.push_back(
          state ? Matrix3d((correction * state->R_start_body).toRotationMatrix())
                : Matrix3d::Identity());
    }
  }
  return grid;
}

// DVL velocity in the body frame with the rig's mounting, interpolated between pings.
class VelocityInterpolator {
 public:
  VelocityInterpolator(const InertialPath& path, const std::vector<DvlPing>& pings,
                       const Matrix3d& mounting) {
    std::vector<double> gaps;
    for (const DvlPing& ping : pings) {
      if (!t_.empty()) gaps.push_back(path.seconds(ping.stamp) - t_.back());
      t_.push_back(path.seconds(ping.stamp));
      v_.emplace_back(mounting * ping.velocity);
    }
    if (gaps.empty()) return;
    max_gap_ = std::clamp(2.5 * median(std::move(gaps)), 1.0, 5.0);
  }

  std::optional<Vector3d> at(double t) const {
    const auto after = std::upper_bound(t_.begin(), t_.end(), t);
    if (after == t_.begin() || after == t_.end()) return std::nullopt;
    const auto i = static_cast<std::size_t>(after - t_.begin());
    const double gap = t_[i] - t_[i - 1];
    if (gap > max_gap_) return std::nullopt;
    const double u = (t - t_[i - 1]) / gap;
    return Vector3d((1.0 - u) * v_[i - 1] + u * v_[i]);
  }

 private:
  std::vector<double> t_;
  std::vector<Vector3d> v_;
  double max_gap_ = 0.0;
};

// Integrals from the first knot to each knot.
struct DeadReckoning {
  std::vector<Vector3d> path;  // of the DVL's velocity
  std::vector<Matrix3d>
      rotations;          // of R ω x dt; times the lever arm: the DVL's motion due to rotation
  std::vector<int> gaps;  // number of steps without velocity so far
};

DeadReckoning dead_reckon(const Grid& grid, const VelocityInterpolator& velocities,
                          double offset_s) {
  DeadReckoning r;
  Vector3d p = Vector3d::Zero();
  int gaps = 0;
  std::size_t knot = 0;
  Vector3d before = Vector3d::Zero();
  bool known_before = false;
  for (std::size_t i = 0; i < grid.t.size(); ++i) {
    const auto v = velocities.at(grid.t[i] + offset_s);
    const bool known = v && grid.valid[i];
    const Vector3d now = grid.R_world_body[i] * v.value_or(Vector3d::Zero());
    const bool whole = i > 0 && known && known_before;
    if (whole) p += 0.5 * (grid.t[i] - grid.t[i - 1]) * (now + before);
    if (i > 0 && !whole) ++gaps;
    before = now;
    known_before = known;
    if (knot < grid.knots.size() && grid.knots[knot] == i) {
      r.path.push_back(p);
      r.rotations.push_back(grid.R_world_body[i]);
      r.gaps.push_back(gaps);
      ++knot;
    }
  }
  return r;
}

struct Normal {
  Matrix A = Matrix::Zero();
  Vector b = Vector::Zero();
  double yy = 0.0;
  double count = 0.0;
};

// One displacement difference: horizontal, divided by the square root of the baseline, which is how
// dead reckoning errors grow.
void add_row(Normal& normal, const Row& row, double y) {
  normal.A += row.transpose() * row;
  normal.b += row.transpose() * y;
  normal.yy += y * y;
  normal.count += 1.0;
}

std::vector<Normal> displacements(const std::vector<Knot>& knots, const DeadReckoning& r,
                                  const Vector3d& lever) {
  std::vector<Normal> groups(kGroups);
  const std::size_t n = r.path.size();
  for (const double baseline : kBaselines) {
    std::size_t j = 0;
    for (std::size_t i = 0; i < n; ++i) {
      while (j < n && knots[j].t < knots[i].t + baseline - 1e-6) ++j;
      if (j == n) break;
      if (r.gaps[i] != r.gaps[j] || knots[j].t > knots[i].t + 1.1 * baseline) continue;
      const Vector3d reckoned = r.path[j] - r.path[i];
      const Matrix3d rotations = -(r.rotations[j] - r.rotations[i]);
      const Vector3d rest = knots[j].position - knots[i].position - reckoned - rotations * lever;
      const Vector3d yawed(-reckoned.y(), reckoned.x(), 0.0);
      Normal& group = groups[i * kGroups / n];
      const double weight = 1.0 / std::sqrt(baseline);
      for (int axis = 0; axis < 2; ++axis) {
        Row row;
        row << yawed(axis), reckoned(axis), rotations.row(axis);
        add_row(group, weight * row, weight * rest(axis));
      }
    }
  }
  return groups;
}

struct Solution {
  Vector x = Vector::Zero();
  double rms = 0.0;  // weighted: of displacements over one second [m]
};

Solution solve(const std::vector<Normal>& groups, bool free_lever, int without = -1) {
  Normal sum;
  for (int g = 0; g < kGroups; ++g) {
    if (g == without) continue;
    const Normal& n = groups[static_cast<std::size_t>(g)];
    sum.A += n.A;
    sum.b += n.b;
    sum.yy += n.yy;
    sum.count += n.count;
  }
  Matrix A = sum.A;
  A.diagonal() += Vector(1e-9, 1e-9, free_lever ? kFreeInformation : kFixedInformation,
                         free_lever ? kFreeInformation : kFixedInformation,
                         free_lever ? 1.0 : kFixedInformation);
  Solution solved;
  solved.x = A.ldlt().solve(sum.b);
  if (!solved.x.allFinite()) solved.x.setZero();
  const double squares = sum.yy - 2.0 * sum.b.dot(solved.x) + solved.x.dot(sum.A * solved.x);
  solved.rms = std::sqrt(std::max(0.0, squares) / std::max(1.0, 0.5 * sum.count));
  return solved;
}

struct Scan {
  std::vector<double> offsets;
  std::vector<std::vector<Normal>> groups;

  Minimum best(bool free_lever, int without = -1) const {
    std::vector<double> costs;
    costs.reserve(groups.size());
    for (const auto& g : groups) {
      const double rms = solve(g, free_lever, without).rms;
      costs.push_back(rms * rms);
    }
    return find_minimum(offsets, costs);
  }
};

double typical_baseline_root() {
  double sum = 0.0;
  for (const double b : kBaselines) sum += b;
  return std::sqrt(sum / static_cast<double>(kBaselines.size()));
}

}  // namespace

std::optional<DvlReferenceFit> fit_dvl_against_reference(const InertialPath& path,
                                                         const std::vector<DvlPing>& pings,
                                                         const DvlMounting& rig,
                                                         const Trajectory& reference) {
  if (path.empty() || !reference.has_rotation || pings.size() < 2) return std::nullopt;
  const std::vector<Knot> knots = knots_of(path, reference);
  if (knots.size() < 10 || knots.back().t - knots.front().t < kMinOverlap) return std::nullopt;
  const Grid grid = grid_of(path, knots);
  const VelocityInterpolator velocities(path, pings, rig.matrix);
  Scan scan;
  scan.offsets = steps(-0.5, 1.5, 0.05);
  for (const double offset : scan.offsets) {
    scan.groups.push_back(
        displacements(knots, dead_reckon(grid, velocities, offset), rig.lever_arm));
  }
  double rows = 0.0;
  for (const Normal& n : scan.groups.front()) rows += n.count;
  if (rows < 60.0) return std::nullopt;
  DvlReferenceFit fit;
  const Minimum fixed_fit = scan.best(false);
  const Minimum free_fit = scan.best(true);
  // Uses the rig's lever arm unless it clearly does not fit this reference.
  fit.lever_arm_is_from_rig = std::sqrt(fixed_fit.value) < 2.0 * std::sqrt(free_fit.value) + 1e-4;
  const bool is_free = !fit.lever_arm_is_from_rig;
  const Minimum best = is_free ? free_fit : fixed_fit;
  if (!best.inside) return std::nullopt;
  const Solution solved = solve(scan.groups[best.index], is_free);
  fit.time_offset_s = best.at;
  fit.yaw_rad = solved.x(0);
  fit.scale = 1.0 + solved.x(1);
  fit.lever_arm = rig.lever_arm + solved.x.tail<3>();
  fit.rms = std::sqrt(std::max(0.0, best.value)) * typical_baseline_root();
  const auto with_rig =
      displacements(knots, dead_reckon(grid, velocities, rig.time_offset_s), rig.lever_arm);
  fit.rms_with_rig = solve(with_rig, is_free).rms * typical_baseline_root();
  std::vector<double> offsets;
  offsets.reserve(kGroups);
  for (int g = 0; g < kGroups; ++g) offsets.push_back(scan.best(is_free, g).at);
  fit.time_offset_sigma_s = jackknife_sigma(offsets);
  return fit;
}

}  // namespace apvi::doctor
