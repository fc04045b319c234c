// SPDX-License-Identifier: BSD-3-Clause
#include "doctor/dvl_reference_fit.hpp"

#include <Eigen/Cholesky>
#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>

#include "apvi/geometry/so3.hpp"
#include "doctor/scan.hpp"

namespace apvi::doctor {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

constexpr double kStep = 0.05;                // of the integration [s]
constexpr double kFewest = 120.0;             // of common time [s]
constexpr double kReferenceStep = 0.5;        // poses closer than this add nothing [s]
constexpr double kLongestReferenceGap = 3.0;  // [s]
constexpr std::array<double, 3> kBaselines = {30.0, 60.0, 100.0};  // [s]
constexpr int kGroups = 5;
constexpr int kUnknowns = 5;  // yaw, scale - 1, lever arm
using Row = Eigen::Matrix<double, 1, kUnknowns>;
using Matrix = Eigen::Matrix<double, kUnknowns, kUnknowns>;
using Vector = Eigen::Matrix<double, kUnknowns, 1>;
// A lever arm is known to a metre or two, if it is free; held else.
constexpr double kFree = 1e-4;
constexpr double kHeld = 1e9;

struct Knot {
  double t = 0.0;
  Eigen::Quaterniond R_world_start;  // turns the gyro's attitude into the reference's
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

// The times of the integration, with the attitude there.
struct Grid {
  std::vector<double> t;
  std::vector<Matrix3d> R_world_body;
  std::vector<bool> good;          // attitude is there
  std::vector<std::size_t> knots;  // index of the first time at or after each knot
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
      grid.good.push_back(state.has_value() && span < kLongestReferenceGap);
      grid.R_world_body.push_back(
          state ? Matrix3d((correction * state->R_start_body).toRotationMatrix())
                : Matrix3d::Identity());
    }
  }
  return grid;
}

// Velocity of the DVL as the rig mounts it, in the body frame, interpolated between pings.
class Velocities {
 public:
  Velocities(const InertialPath& path, const std::vector<DvlPing>& pings,
             const Matrix3d& mounting) {
    std::vector<double> gaps;
    for (const DvlPing& ping : pings) {
      if (!t_.empty()) gaps.push_back(path.seconds(ping.stamp) - t_.back());
      t_.push_back(path.seconds(ping.stamp));
      v_.emplace_back(mounting * ping.velocity);
    }
    if (gaps.empty()) return;
    const auto middle = gaps.begin() + static_cast<std::ptrdiff_t>(gaps.size() / 2);
    std::nth_element(gaps.begin(), middle, gaps.end());
    longest_gap_ = std::clamp(2.5 * *middle, 1.0, 5.0);
  }

  std::optional<Vector3d> at(double t) const {
    const auto after = std::upper_bound(t_.begin(), t_.end(), t);
    if (after == t_.begin() || after == t_.end()) return std::nullopt;
    const auto i = static_cast<std::size_t>(after - t_.begin());
    const double gap = t_[i] - t_[i - 1];
    if (gap > longest_gap_) return std::nullopt;
    const double u = (t - t_[i - 1]) / gap;
    return Vector3d((1.0 - u) * v_[i - 1] + u * v_[i]);
  }

 private:
  std::vector<double> t_;
  std::vector<Vector3d> v_;
  double longest_gap_ = 0.0;
};

// Integrals from the first knot to each knot.
struct Reckoning {
  std::vector<Vector3d> path;    // of the DVL's velocity
  std::vector<Matrix3d> turned;  // of R ω x dt: what times the lever arm is the DVL's own path
  std::vector<int> holes;        // steps without velocity so far
};

Reckoning reckon(const Grid& grid, const Velocities& velocities, double offset_s) {
  Reckoning r;
  Vector3d p = Vector3d::Zero();
  int holes = 0;
  std::size_t knot = 0;
  Vector3d before = Vector3d::Zero();
  bool known_before = false;
  for (std::size_t i = 0; i < grid.t.size(); ++i) {
    const auto v = velocities.at(grid.t[i] + offset_s);
    const bool known = v && grid.good[i];
    const Vector3d now = grid.R_world_body[i] * v.value_or(Vector3d::Zero());
    const bool whole = i > 0 && known && known_before;
    if (whole) p += 0.5 * (grid.t[i] - grid.t[i - 1]) * (now + before);
    if (i > 0 && !whole) ++holes;
    before = now;
    known_before = known;
    if (knot < grid.knots.size() && grid.knots[knot] == i) {
      r.path.push_back(p);
      r.turned.push_back(grid.R_world_body[i]);
      r.holes.push_back(holes);
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

// One difference of displacements: horizontal, divided by the root of the baseline since errors of
// dead reckoning grow about so.
void add_row(Normal& normal, const Row& row, double y) {
  normal.A += row.transpose() * row;
  normal.b += row.transpose() * y;
  normal.yy += y * y;
  normal.count += 1.0;
}

std::vector<Normal> displacements(const std::vector<Knot>& knots, const Reckoning& r,
                                  const Vector3d& lever) {
  std::vector<Normal> groups(kGroups);
  const std::size_t n = r.path.size();
  for (const double baseline : kBaselines) {
    std::size_t j = 0;
    for (std::size_t i = 0; i < n; ++i) {
      while (j < n && knots[j].t < knots[i].t + baseline - 1e-6) ++j;
      if (j == n) break;
      if (r.holes[i] != r.holes[j] || knots[j].t > knots[i].t + 1.1 * baseline) continue;
      const Vector3d reckoned = r.path[j] - r.path[i];
      const Matrix3d turned = -(r.turned[j] - r.turned[i]);
      const Vector3d rest = knots[j].position - knots[i].position - reckoned - turned * lever;
      const Vector3d yawed(-reckoned.y(), reckoned.x(), 0.0);
      Normal& group = groups[i * kGroups / n];
      const double weight = 1.0 / std::sqrt(baseline);
      for (int axis = 0; axis < 2; ++axis) {
        Row row;
        row << yawed(axis), reckoned(axis), turned.row(axis);
        add_row(group, weight * row, weight * rest(axis));
      }
    }
  }
  return groups;
}

struct Solved {
  Vector x = Vector::Zero();
  double rms = 0.0;  // weighted: of a displacement over a second [m]
};

Solved solve(const std::vector<Normal>& groups, bool free_lever, int without = -1) {
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
  A.diagonal() += Vector(1e-9, 1e-9, free_lever ? kFree : kHeld, free_lever ? kFree : kHeld,
                         free_lever ? 1.0 : kHeld);
  Solved solved;
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
    return lowest(offsets, costs);
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
  if (knots.size() < 10 || knots.back().t - knots.front().t < kFewest) return std::nullopt;
  const Grid grid = grid_of(path, knots);
  const Velocities velocities(path, pings, rig.matrix);
  Scan scan;
  scan.offsets = steps(-0.5, 1.5, 0.05);
  for (const double offset : scan.offsets) {
    scan.groups.push_back(displacements(knots, reckon(grid, velocities, offset), rig.lever_arm));
  }
  double rows = 0.0;
  for (const Normal& n : scan.groups.front()) rows += n.count;
  if (rows < 60.0) return std::nullopt;
  DvlReferenceFit fit;
  const Minimum held = scan.best(false);
  const Minimum freed = scan.best(true);
  // The rig's lever arm unless it is clearly wrong for this reference.
  fit.lever_arm_is_rigs = std::sqrt(held.value) < 2.0 * std::sqrt(freed.value) + 1e-4;
  const bool is_free = !fit.lever_arm_is_rigs;
  const Minimum best = is_free ? freed : held;
  if (!best.inside) return std::nullopt;
  const Solved solved = solve(scan.groups[best.index], is_free);
  fit.time_offset_s = best.at;
  fit.yaw_rad = solved.x(0);
  fit.scale = 1.0 + solved.x(1);
  fit.lever_arm = rig.lever_arm + solved.x.tail<3>();
  fit.rms = std::sqrt(std::max(0.0, best.value)) * typical_baseline_root();
  const auto as_rig =
      displacements(knots, reckon(grid, velocities, rig.time_offset_s), rig.lever_arm);
  fit.rms_as_rig = solve(as_rig, is_free).rms * typical_baseline_root();
  std::vector<double> offsets;
  offsets.reserve(kGroups);
  for (int g = 0; g < kGroups; ++g) offsets.push_back(scan.best(is_free, g).at);
  fit.time_offset_sigma_s = jackknife_sigma(offsets);
  return fit;
}

}  // namespace apvi::doctor
