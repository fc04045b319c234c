// SPDX-License-Identifier: BSD-3-Clause
#include "doctor/depth_lag.hpp"

#include <algorithm>
#include <cmath>

#include "doctor/scan.hpp"

namespace apvi::doctor {
namespace {

using Eigen::Vector3d;

constexpr double kBaseline = 2.0;   // [s]
constexpr double kMaxGap = 2.5;     // of the DVL [s]
constexpr double kScanRange = 1.0;  // of the scan [s]
constexpr double kStep = 0.05;      // [s]
constexpr std::size_t kMinPairs = 60;
constexpr double kMinDepthChange = 0.002;  // [m]
constexpr int kGroups = 8;

// Depth relative to the first ping, integrated from DVL velocities.
struct DvlDepth {
  std::vector<double> t;
  std::vector<double> depth;
  std::vector<int> gaps;

  std::optional<double> change(double from, double to) const {
    const auto a = at(from);
    const auto b = at(to);
    if (!a || !b || a->second != b->second) return std::nullopt;
    return b->first - a->first;
  }

 private:
  std::optional<std::pair<double, int>> at(double when) const {
    const auto after = std::upper_bound(t.begin(), t.end(), when);
    if (after == t.begin() || after == t.end()) return std::nullopt;
    const auto i = static_cast<std::size_t>(after - t.begin());
    const double u = (when - t[i - 1]) / (t[i] - t[i - 1]);
    return std::pair{depth[i - 1] + u * (depth[i] - depth[i - 1]), gaps[u < 0.5 ? i - 1 : i]};
  }
};

DvlDepth integrate_depth(const InertialPath& path, const std::vector<DvlPing>& pings,
                         const DvlMounting& rig, double delay_s) {
  DvlDepth result;
  double before = 0.0;
  for (const DvlPing& ping : pings) {
    const double t = path.seconds(ping.stamp);
    const auto state = path.at(t - delay_s);
    const auto rate = path.rate_at(t - delay_s);
    if (!state || !rate) continue;
    const Vector3d body = rig.matrix * ping.velocity - rate->cross(rig.lever_arm);
    const double down = -state->up_body.dot(body);
    const bool first = result.t.empty();
    const double dt = first ? 0.0 : t - result.t.back();
    const bool gap = dt > kMaxGap;
    result.depth.push_back(first ? 0.0 : result.depth.back() + 0.5 * dt * (before + down));
    result.gaps.push_back(first ? 0 : result.gaps.back() + (gap ? 1 : 0));
    result.t.push_back(t);
    before = down;
  }
  return result;
}

struct Change {
  double from = 0.0;
  double to = 0.0;
  double depth = 0.0;
};

std::vector<Change> depth_changes(const InertialPath& path, const std::vector<DepthPoint>& depths,
                                  const Vector3d& p_sensor) {
  std::vector<std::pair<double, double>> points;
  for (const DepthPoint& point : depths) {
    const double t = path.seconds(point.stamp);
    const auto state = path.at(t);
    if (state) points.emplace_back(t, point.depth + state->up_body.dot(p_sensor));
  }
  std::vector<Change> changes;
  std::size_t j = 0;
  for (const auto& [t, depth] : points) {
    while (j < points.size() && points[j].first < t + kBaseline) ++j;
    if (j == points.size()) break;
    if (points[j].first > t + 1.5 * kBaseline) continue;
    changes.push_back({t, points[j].first, points[j].second - depth});
  }
  return changes;
}

struct Moments {
  double n = 0.0, x = 0.0, y = 0.0, xx = 0.0, xy = 0.0, yy = 0.0;

  void add(double a, double b) {
    n += 1.0;
    x += a;
    y += b;
    xx += a * a;
    xy += a * b;
    yy += b * b;
  }
  double correlation() const {
    const double cov = xy - x * y / n;
    const double product = (xx - x * x / n) * (yy - y * y / n);
    return n > 2.0 && product > 0.0 ? cov / std::sqrt(product) : 0.0;
  }
};

using Groups = std::vector<Moments>;

Groups compare(const std::vector<Change>& changes, const DvlDepth& integrate_depth,
               double delay_s) {
  Groups groups(kGroups);
  for (std::size_t i = 0; i < changes.size(); ++i) {
    // With stamps delayed by `delay_s`, data of time t have the stamp t + delay_s.
    const auto change = integrate_depth.change(changes[i].from + delay_s, changes[i].to + delay_s);
    if (change) groups[i * kGroups / changes.size()].add(*change, changes[i].depth);
  }
  return groups;
}

Moments sum(const Groups& groups, int without = -1) {
  Moments total;
  for (int g = 0; g < kGroups; ++g) {
    if (g == without) continue;
    const Moments& m = groups[static_cast<std::size_t>(g)];
    total.n += m.n;
    total.x += m.x;
    total.y += m.y;
    total.xx += m.xx;
    total.xy += m.xy;
    total.yy += m.yy;
  }
  return total;
}

Minimum best_of(const std::vector<double>& offsets, const std::vector<Groups>& scan, int without) {
  std::vector<double> costs;
  costs.reserve(scan.size());
  for (const Groups& groups : scan) {
    const double r = sum(groups, without).correlation();
    costs.push_back(-r * r);
  }
  return find_minimum(offsets, costs);
}

}  // namespace

std::optional<DepthLag> fit_dvl_against_depth(const InertialPath& path,
                                              const std::vector<DvlPing>& pings,
                                              const DvlMounting& rig,
                                              const std::vector<DepthPoint>& depths,
                                              const Vector3d& p_sensor) {
  if (path.empty() || pings.size() < 2) return std::nullopt;
  const std::vector<Change> changes = depth_changes(path, depths, p_sensor);
  if (changes.size() < kMinPairs) return std::nullopt;
  const std::vector<double> offsets = steps(-kScanRange, kScanRange, kStep);
  std::vector<Groups> scan;
  scan.reserve(offsets.size());
  for (const double late : offsets)
    scan.push_back(compare(changes, integrate_depth(path, pings, rig, late), late));
  const Minimum best = best_of(offsets, scan, -1);
  const Moments moments = sum(scan[best.index]);
  DepthLag lag;
  lag.depth_change = std::sqrt(moments.yy / std::max(1.0, moments.n));
  if (moments.n < static_cast<double>(kMinPairs) || lag.depth_change < kMinDepthChange ||
      !best.inside) {
    return std::nullopt;
  }
  lag.time_offset_s = best.at;
  lag.correlation = moments.correlation();
  std::vector<double> left_out;
  left_out.reserve(kGroups);
  for (int g = 0; g < kGroups; ++g) left_out.push_back(best_of(offsets, scan, g).at);
  lag.time_offset_sigma_s = jackknife_sigma(left_out);
  return lag;
}

}  // namespace apvi::doctor
