// SPDX-License-Identifier: BSD-3-Clause
#include "fusion/combine.hpp"

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <cmath>
#include <limits>

namespace apvi::fusion {
namespace {

double log_determinant(const Matrix6& m) {
  const Eigen::LLT<Matrix6> llt(m);
  if (llt.info() != Eigen::Success) return -std::numeric_limits<double>::infinity();
  return 2.0 * Matrix6(llt.matrixL()).diagonal().array().log().sum();
}

// The weight that maximizes the determinant of the information, which is log-concave in the weight.
double best_weight(const Matrix6& first, const Matrix6& second) {
  constexpr double kGolden = 0.6180339887498949;
  const auto value = [&](double w) { return log_determinant(w * first + (1.0 - w) * second); };
  double low = 0.0;
  double high = 1.0;
  for (int i = 0; i < 40; ++i) {
    const double a = high - kGolden * (high - low);
    const double b = low + kGolden * (high - low);
    if (value(a) < value(b)) {
      low = a;
    } else {
      high = b;
    }
  }
  const double inside = 0.5 * (low + high);
  // The golden-section search never reaches the ends of the interval: test them.
  if (value(1.0) >= value(inside)) return 1.0;
  return value(0.0) >= value(inside) ? 0.0 : inside;
}

}  // namespace

PoseEstimate fuse_independent(const PoseEstimate& dipo, const SE3& vio,
                              const Matrix6& information) {
  const Matrix6& P = dipo.covariance;
  const Matrix6 H = symmetric(information);
  const Eigen::PartialPivLU<Matrix6> lu(Matrix6::Identity() + P * H);
  const Vector6 innovation = boxminus(vio, dipo.T_world_body);
  const Vector6 correction = lu.solve(P * (H * innovation));
  return {boxplus(dipo.T_world_body, correction), symmetric(lu.solve(P))};
}

CovarianceIntersection intersect_covariances(const PoseEstimate& dipo, const SE3& vio,
                                             const Matrix6& information) {
  const Matrix6 first = symmetric(dipo.covariance.ldlt().solve(Matrix6::Identity()));
  const Matrix6 second = symmetric(information);
  const double weight = best_weight(first, second);
  const Matrix6 sum = weight * first + (1.0 - weight) * second;
  const Eigen::LDLT<Matrix6> ldlt(sum);
  const Vector6 correction = ldlt.solve((1.0 - weight) * second * boxminus(vio, dipo.T_world_body));
  return {{boxplus(dipo.T_world_body, correction), symmetric(ldlt.solve(Matrix6::Identity()))},
          weight};
}

}  // namespace apvi::fusion
