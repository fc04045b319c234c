// SPDX-License-Identifier: BSD-3-Clause
#include "io/folder/gravity_turn.hpp"

#include <Eigen/Geometry>

namespace apvi::io {
namespace {

constexpr double kStep = 0.1;     // [s]
constexpr double kMaxStep = 0.3;  // between the beginnings of two steps, else there is a gap [s]

}  // namespace

void GravityTurn::add(const ImuSample& sample) {
  if (!sample.gyro.allFinite() || !sample.accel.allFinite()) return;
  if (step_.count > 0.0 && seconds_between(step_.start, sample.stamp) >= kStep) finish_step();
  if (step_.count == 0.0) step_.start = sample.stamp;
  step_.count += 1.0;
  step_.rate += sample.gyro;
  step_.force += sample.accel;
}

// A vector that is fixed to the world turns in the body against the body's rotation.
void GravityTurn::finish_step() {
  Step mean = step_;
  mean.rate /= step_.count;
  mean.force /= step_.count;
  step_ = {};
  if (before_) {
    const double dt = seconds_between(before_->start, mean.start);
    const Eigen::Vector3d rate = 0.5 * (before_->rate + mean.rate);
    const Eigen::Vector3d force = 0.5 * (before_->force + mean.force);
    const Eigen::Vector3d by_gyro = dt * force.cross(rate);
    if (dt < kMaxStep) {
      common_ += by_gyro.dot(mean.force - before_->force);
      predicted_ += by_gyro.squaredNorm();
    }
  }
  before_ = mean;
}

}  // namespace apvi::io
