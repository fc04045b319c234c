// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <vector>

#include "doctor/inertial_path.hpp"
#include "doctor/observations.hpp"

namespace apvi::doctor {

/// Order of the linear unknowns: the columns of the mounting matrix, the lever arm, the
/// accelerometer's bias.
inline constexpr int kMounting = 0;
inline constexpr int kLever = 9;
inline constexpr int kAccelBias = 12;
inline constexpr int kChangeSize = 15;
using ChangeVector = Eigen::Matrix<double, kChangeSize, 1>;
using ChangeMatrix = Eigen::Matrix<double, kChangeSize, kChangeSize>;

/// Changes of velocity within one span of some 20 s, with its own gravity.
struct ChangeBlock {
  Eigen::Matrix<double, Eigen::Dynamic, kChangeSize> unknowns;  ///< three rows a change
  Eigen::Matrix<double, Eigen::Dynamic, 6> gravity;             ///< constant and slope
  Eigen::VectorXd felt;                                         ///< by the accelerometer [m/s]
};

/// Which pings make a change of velocity, and how long gravity's direction is one line.
struct ChangeSpans {
  double shortest_s = 0.9;  ///< between the pings of a change
  double block_s = 20.0;
};

/// The equations with the DVL's stamps taken as late by `offset_s`.
std::vector<ChangeBlock> velocity_changes(const InertialPath& path,
                                          const std::vector<DvlPing>& pings, double offset_s,
                                          const ChangeSpans& spans);

/// unknowns = base + basis * x; `prior` is the information on each x, about zero.
struct ChangeModel {
  ChangeVector base = ChangeVector::Zero();
  Eigen::Matrix<double, kChangeSize, Eigen::Dynamic> basis;
  Eigen::VectorXd prior;
};

/// Normal equations of one block, gravity eliminated, weighted.
struct ChangeNormal {
  ChangeMatrix A = ChangeMatrix::Zero();
  ChangeVector b = ChangeVector::Zero();
  double yy = 0.0;
};

struct ChangeSolution {
  Eigen::VectorXd x;
  double sum = 0.0;  ///< of weighted squares
  double rms = 0.0;  ///< of a change, Huber's weights [m/s]
  std::vector<ChangeNormal> normals;
};

/// Least squares with Huber weights.
ChangeSolution solve(const std::vector<ChangeBlock>& blocks, const ChangeModel& model);
/// The same from summed normal equations: x and the sum of squares.
ChangeSolution solve(const ChangeNormal& normal, const ChangeModel& model);

}  // namespace apvi::doctor
