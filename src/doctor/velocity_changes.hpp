// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <vector>

#include "doctor/inertial_path.hpp"
#include "doctor/observations.hpp"

namespace apvi::doctor {

/// Order of the linear unknowns: columns of the mounting matrix, lever arm, accelerometer bias.
inline constexpr int kMounting = 0;
inline constexpr int kLever = 9;
inline constexpr int kAccelBias = 12;
inline constexpr int kChangeSize = 15;
using ChangeVector = Eigen::Matrix<double, kChangeSize, 1>;
using ChangeMatrix = Eigen::Matrix<double, kChangeSize, kChangeSize>;

/// Velocity changes within one block of about 20 s, which has its own gravity unknowns.
struct ChangeBlock {
  Eigen::Matrix<double, Eigen::Dynamic, kChangeSize> unknowns;  ///< three rows per change
  Eigen::Matrix<double, Eigen::Dynamic, 6> gravity;             ///< constant and slope
  Eigen::VectorXd force_change;                                 ///< integrated specific force [m/s]
};

/// Time spans of a velocity change, and of a block with linear gravity direction.
struct ChangeSpans {
  double shortest_s = 0.9;  ///< minimum time between the pings of a change
  double block_s = 20.0;
};

/// The equations for DVL stamps delayed by `offset_s`.
std::vector<ChangeBlock> velocity_changes(const InertialPath& path,
                                          const std::vector<DvlPing>& pings, double offset_s,
                                          const ChangeSpans& spans);

/// unknowns = base + basis * x; `prior` is the information of a zero-mean prior on each x.
struct ChangeModel {
  ChangeVector base = ChangeVector::Zero();
  Eigen::Matrix<double, kChangeSize, Eigen::Dynamic> basis;
  Eigen::VectorXd prior;
};

/// Weighted normal equations of one block with gravity eliminated.
struct ChangeNormal {
  ChangeMatrix A = ChangeMatrix::Zero();
  ChangeVector b = ChangeVector::Zero();
  double yy = 0.0;
};

struct ChangeSolution {
  Eigen::VectorXd x;
  double sum = 0.0;  ///< of weighted squared residuals
  double rms = 0.0;  ///< of the changes, with Huber weights [m/s]
  std::vector<ChangeNormal> normals;
};

/// Least squares with Huber weights.
ChangeSolution solve(const std::vector<ChangeBlock>& blocks, const ChangeModel& model);
/// From summed normal equations: x and the sum of squares only.
ChangeSolution solve(const ChangeNormal& normal, const ChangeModel& model);

}  // namespace apvi::doctor
