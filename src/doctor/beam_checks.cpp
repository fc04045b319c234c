// SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>

#include <Eigen/Geometry>
#include <Eigen/SVD>
#include <algorithm>
#include <cmath>
#include <limits>

#include "apvi/core/constants.hpp"
#include "doctor/checks.hpp"

namespace apvi::doctor {
namespace {

using Beams = Eigen::Matrix<double, 4, 3>;
using Eigen::Matrix3d;
using Eigen::Vector3d;
using Eigen::Vector4d;

constexpr std::size_t kMinPings = 30;
constexpr double kMinRmsSpeed = 0.03;  // below this the velocity is not informative [m/s]

Beams matrix_of(const std::array<Vector3d, kDvlBeams>& beams) {
  Beams m;
  for (Eigen::Index i = 0; i < 4; ++i) m.row(i) = beams[static_cast<std::size_t>(i)];
  return m;
}

// The combination of beams that is zero for every velocity.
Vector4d parity_of(const Beams& beams) {
  return Eigen::JacobiSVD<Beams>(beams, Eigen::ComputeFullU).matrixU().col(3);
}

double parity_rms(const BeamMoments& moments, const Vector4d& parity) {
  const double sum = parity.dot(moments.beam_beam * parity);
  return std::sqrt(std::max(0.0, sum) / static_cast<double>(moments.count));
}

// Finds a beam order with small parity error: which beam is opposite to the first.
std::string opposite_of_first(const BeamMoments& moments, double rms) {
  const std::array<Vector4d, 3> signs = {Vector4d(1, 1, -1, -1) / 2.0, Vector4d(1, -1, 1, -1) / 2.0,
                                         Vector4d(1, -1, -1, 1) / 2.0};
  for (std::size_t i = 0; i < signs.size(); ++i) {
    // Both pairs of opposite beams have the same sum.
    if (parity_rms(moments, signs[i]) < 0.3 * rms) {
      return fmt::format("; with beam 0 opposite to beam {} it would be {:.3g} m/s", i + 1,
                         parity_rms(moments, signs[i]));
    }
  }
  return "";
}

void check_parity(const CheckInput& c, const Beams& beams, Report& report) {
  const BeamMoments& moments = c.observed.dvl.beams;
  const double rms = parity_rms(moments, parity_of(beams));
  Finding f{Severity::ok,
            "dvl0",
            "beam parity",
            fmt::format("beam velocities are inconsistent by {:.3g} m/s RMS", rms),
            "",
            {{"rms_m_s", rms}}};
  const double noise = c.rig.dvl->velocity_noise;
  if (rms > std::max(5.0 * noise, 0.05)) {
    const std::string order = opposite_of_first(moments, rms);
    f.severity = Severity::warning;
    f.message += order;
    f.advice = order.empty() ? "a beam is bad, or dvl0.beams in the rig does not match this device"
                             : "reorder dvl0.beams in the rig to match the device";
  } else if (rms > 3.0 * noise) {
    f.severity = Severity::note;
    f.advice = fmt::format("set dvl0.velocity_noise in the rig to about {:.2g}", rms);
  }
  report.add(std::move(f));
}

double misfit_rms(const BeamMoments& m, const Beams& beams) {
  const double sum = m.beam_beam.trace() - 2.0 * (beams * m.velocity_beam).trace() +
                     (beams * m.velocity_velocity * beams.transpose()).trace();
  return std::sqrt(std::max(0.0, sum) / (4.0 * static_cast<double>(m.count)));
}

// All rotations and reflections that map axes to axes.
std::vector<Matrix3d> axis_maps() {
  std::vector<Matrix3d> maps;
  std::array<int, 3> order = {0, 1, 2};
  do {
    for (int signs = 0; signs < 8; ++signs) {
      Matrix3d m = Matrix3d::Zero();
      for (int i = 0; i < 3; ++i)
        m(i, order[static_cast<std::size_t>(i)]) = (signs >> i) & 1 ? -1.0 : 1.0;
      maps.push_back(m);
    }
  } while (std::next_permutation(order.begin(), order.end()));
  return maps;
}

std::string describe(const Matrix3d& map) {
  if (map.determinant() < 0.0) return "mirrored";
  const Eigen::AngleAxisd turn(map);
  Eigen::Index axis = 0;
  const double along = turn.axis().cwiseAbs().maxCoeff(&axis);
  const double angle = kDegreesPerRadian * turn.angle();
  if (along < 0.99) return fmt::format("rotated by {:.0f} deg about an oblique axis", angle);
  return fmt::format("rotated by {:.0f} deg about {}", angle, "xyz"[axis]);
}

std::string as_yaml(const Beams& beams) {
  std::string text = "[";
  for (Eigen::Index i = 0; i < 4; ++i) {
    text += fmt::format("{}[{:.6f}, {:.6f}, {:.6f}]", i > 0 ? ", " : "", beams(i, 0), beams(i, 1),
                        beams(i, 2));
  }
  return text + "]";
}

void check_against_velocity(const CheckInput& c, const Beams& beams, Report& report) {
  BeamMoments m = c.observed.dvl.beams;
  const Matrix3d signs = c.rig.dvl->axis_signs.asDiagonal();
  m.velocity_beam = signs * m.velocity_beam;
  m.velocity_velocity = signs * m.velocity_velocity * signs;
  if (m.velocity_velocity.trace() < kMinRmsSpeed * kMinRmsSpeed * static_cast<double>(m.count))
    return;
  const double rms = misfit_rms(m, beams);
  Matrix3d best = Matrix3d::Identity();
  double lowest = rms;
  for (const Matrix3d& map : axis_maps()) {
    const double candidate = misfit_rms(m, beams * map);
    if (candidate < lowest - 1e-9) {
      lowest = candidate;
      best = map;
    }
  }
  Finding f{Severity::ok,
            "dvl0",
            "beams, velocity",
            fmt::format("the beams agree with the velocity to {:.3g} m/s RMS", rms),
            "",
            {{"rms_m_s", rms}, {"best_rms_m_s", lowest}}};
  if (rms > 2.0 * lowest + 0.01) {
    f.severity = Severity::warning;
    f.message =
        fmt::format("the beams are {} relative to the velocity: {:.3g} m/s RMS, corrected {:.3g}",
                    describe(best), lowest, rms);
    f.advice =
        "the device applies a mounting offset to its velocity but not to its beams; set dvl0.beams "
        "in "
        "the rig to " +
        as_yaml(beams * best);
  } else if (rms > std::max(5.0 * c.rig.dvl->velocity_noise, 0.05)) {
    f.severity = Severity::warning;
    f.advice = "dvl0.beams in the rig does not match this device";
  }
  report.add(std::move(f));
}

}  // namespace

void check_beams(const CheckInput& c, Report& report) {
  if (!c.rig.dvl || c.observed.dvl.beams.count < kMinPings) return;
  const Beams beams = matrix_of(c.rig.dvl->beams);
  check_parity(c, beams, report);
  check_against_velocity(c, beams, report);
}

}  // namespace apvi::doctor
