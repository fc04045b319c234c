// SPDX-License-Identifier: BSD-3-Clause
#include "dipo/dvl_ping.hpp"

#include <Eigen/Cholesky>
#include <algorithm>

namespace apvi::dipo {
namespace {

using Eigen::Matrix3d;

constexpr int kAllBeams = static_cast<int>(kDvlBeams);

// All beams in lock; `common` is the covariance of noise shared by all beams, in the DVL frame.
Measurement beams_measurement(const State& x, const Kinematics& k, const imu::EarthModel& world,
                              const DvlCalibration& dvl, const DvlSample& ping, double variance,
                              const Matrix3d& common) {
  Measurement all(valid_beams(ping));
  Eigen::Matrix<double, Eigen::Dynamic, 3, 0, kAllBeams, 3> directions(all.rows(), 3);
  int row = 0;
  for (std::size_t i = 0; i < kDvlBeams; ++i) {
    if (!ping.beams[i] || !ping.beams[i]->valid) continue;
    const Measurement m =
        dvl_beam(x, k, world, dvl.beams[i], dvl.scale * ping.beams[i]->velocity, variance);
    all.residual(row) = m.residual(0);
    all.H.row(row) = m.H;
    directions.row(row++) = dvl.beams[i];
  }
  all.R = directions * common * directions.transpose();
  all.R.diagonal().array() += variance;
  return all;
}

}  // namespace

int valid_beams(const DvlSample& ping) {
  return static_cast<int>(std::count_if(ping.beams.begin(), ping.beams.end(),
                                        [](const auto& beam) { return beam && beam->valid; }));
}

bool same_ping(const DvlSample& a, const DvlSample& b) {
  const auto same_beam = [](const std::optional<DvlBeam>& x, const std::optional<DvlBeam>& y) {
    return x.has_value() == y.has_value() &&
           (!x || (x->velocity == y->velocity && x->valid == y->valid));
  };
  return a.valid == b.valid && a.velocity == b.velocity && a.altitude == b.altitude &&
         std::equal(a.beams.begin(), a.beams.end(), b.beams.begin(), same_beam);
}

bool is_usable(const DvlSample& ping, bool use_beams) {
  return ping.valid || (use_beams && valid_beams(ping) > 0 && ping.altitude.value_or(1.0) > 0.0);
}

double beam_disagreement(const DvlSample& ping, const DvlCalibration& dvl) {
  if (valid_beams(ping) < kAllBeams) return 0.0;
  Eigen::Matrix<double, kAllBeams, 3> E;
  Eigen::Matrix<double, kAllBeams, 1> b;
  for (std::size_t i = 0; i < kDvlBeams; ++i) {
    E.row(static_cast<Eigen::Index>(i)) = dvl.beams[i];
    b(static_cast<Eigen::Index>(i)) = ping.beams[i]->velocity;
  }
  return (b - E * (E.transpose() * E).ldlt().solve(E.transpose() * b)).norm();
}

Measurement ping_measurement(const Eskf& filter, const Kinematics& k, const imu::EarthModel& world,
                             const DvlCalibration& dvl, const DvlSample& ping, bool by_beam,
                             double variance, double offset_s) {
  const State& x = filter.state();
  const Matrix3d noise = time_offset_noise(filter, k, world);
  Measurement m = by_beam ? beams_measurement(x, k, world, dvl, ping, variance, noise)
                          : dvl_velocity(x, k, world, dvl.true_velocity(ping.velocity),
                                         variance * Matrix3d::Identity() + noise);
  // Correct to first order if the offset estimate has changed since the stamp was computed.
  m.residual -= m.H.col(kTimeOffset) * (x.dvl_time_offset_s - offset_s);
  return m;
}

}  // namespace apvi::dipo
