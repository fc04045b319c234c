// SPDX-License-Identifier: BSD-3-Clause
#include "doctor/dvl_imu_fit.hpp"

#include <Eigen/Cholesky>
#include <Eigen/Geometry>
#include <Eigen/SVD>
#include <algorithm>
#include <array>
#include <cmath>

#include "apvi/core/constants.hpp"
#include "apvi/geometry/so3.hpp"
#include "core/median.hpp"
#include "doctor/scan.hpp"
#include "doctor/velocity_changes.hpp"

namespace apvi::doctor {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

constexpr double kShortSpan = 0.12;  // between the pings of a velocity change [s]
constexpr double kLongSpan = 0.9;    // between the pings of a velocity change [s]
constexpr double kScanRange = 1.0;   // of the coarse scan over time offsets [s]
constexpr double kCoarseStep = 0.05;
constexpr double kFineRange = 0.1;  // of the fine scan [s]
constexpr double kFineStep = 0.02;
constexpr std::size_t kMinBlocks = 2;
// Required ratio of the scan's minimum to its median, for the minimum to be significant.
constexpr double kMaxDipRatio = 0.97;
constexpr std::size_t kGroups = 10;
constexpr double kMaxMountingChange = 20.0 * kRadiansPerDegree;

// Solutions of a scan over time offsets.
struct Scan {
  std::vector<double> offsets;
  std::vector<ChangeSolution> solutions;
  std::vector<Matrix3d> mountings;  // of each solution; rigid models only
  Minimum best;
  ChangeSpans spans;
  double dip = 1.0;  // RMS at the minimum over the scan's median
};

ChangeVector as_vector(const Matrix3d& mounting) {
  ChangeVector v = ChangeVector::Zero();
  v.head<9>() = Eigen::Map<const Eigen::Matrix<double, 9, 1>>(mounting.data());
  return v;
}

Matrix3d matrix_in(const Eigen::VectorXd& x) {
  return Eigen::Map<const Matrix3d>(x.data());
}

ChangeModel free_model() {
  ChangeModel model;
  model.basis = ChangeMatrix::Identity();
  model.prior = Eigen::VectorXd::Constant(kChangeSize, 1e-6);
  model.prior.tail<3>().setConstant(1e-4);  // weak prior on the accelerometer bias
  return model;
}

// Unknowns: a small rotation in the body frame, lever arm, accelerometer bias.
ChangeModel rigid_model(const Matrix3d& mounting) {
  ChangeModel model;
  model.base = as_vector(mounting);
  model.basis = Eigen::MatrixXd::Zero(kChangeSize, 9);
  for (int j = 0; j < 3; ++j) {
    model.basis.col(j) = as_vector(so3::hat(Vector3d::Unit(j)) * mounting);
  }
  model.basis.bottomRightCorner<6, 6>().setIdentity();
  model.prior = free_model().prior.tail<9>();
  return model;
}

ChangeModel rig_model(const DvlMounting& rig) {
  ChangeModel model;
  model.base = as_vector(rig.matrix);
  model.base.segment<3>(kLever) = rig.lever_arm;
  model.basis = Eigen::MatrixXd::Zero(kChangeSize, 3);
  model.basis.bottomRows<3>().setIdentity();
  model.prior = free_model().prior.tail<3>();
  return model;
}

void find_scan_minimum(Scan& scan) {
  std::vector<double> costs;
  costs.reserve(scan.solutions.size());
  for (const ChangeSolution& s : scan.solutions) costs.push_back(s.rms * s.rms);
  scan.best = find_minimum(scan.offsets, costs);
}

std::optional<Scan> scan_free(const InertialPath& path, const std::vector<DvlPing>& pings,
                              const ChangeSpans& spans) {
  Scan scan;
  scan.spans = spans;
  scan.offsets = steps(-kScanRange, kScanRange, kCoarseStep);
  std::vector<double> rms;
  for (const double offset : scan.offsets) {
    const auto blocks = velocity_changes(path, pings, offset, spans);
    if (blocks.size() < kMinBlocks) return std::nullopt;
    scan.solutions.push_back(solve(blocks, free_model()));
    rms.push_back(scan.solutions.back().rms);
  }
  find_scan_minimum(scan);
  const double usual = median(std::move(rms));
  scan.dip = std::sqrt(std::max(0.0, scan.best.value)) / std::max(1e-12, usual);
  if (!scan.best.inside || scan.dip > kMaxDipRatio) return std::nullopt;
  return scan;
}

// Short spans favor the accelerometer's accuracy, long ones the DVL's: uses the span with the
// clearer minimum over time offsets.
std::optional<Scan> scan_free(const InertialPath& path, const std::vector<DvlPing>& pings) {
  const double span = path.seconds(pings.back().stamp) - path.seconds(pings.front().stamp);
  const double block = std::clamp(span / 4.0, 5.0, 20.0);
  auto near = scan_free(path, pings, {.shortest_s = kShortSpan, .block_s = block});
  auto far = scan_free(path, pings, {.shortest_s = kLongSpan, .block_s = block});
  if (!far) return near;
  return near && near->dip < far->dip ? near : far;
}

Scan scan_rigid(const InertialPath& path, const std::vector<DvlPing>& pings, const Scan& coarse,
                const Matrix3d& mounting) {
  Scan scan;
  scan.spans = coarse.spans;
  const double around = coarse.best.at;
  scan.offsets = steps(around - kFineRange, around + kFineRange, kFineStep);
  for (const double offset : scan.offsets) {
    const auto blocks = velocity_changes(path, pings, offset, scan.spans);
    Matrix3d m = mounting;
    ChangeSolution solution;
    for (int round = 0; round < 3; ++round) {
      solution = solve(blocks, rigid_model(m));
      m = so3::exp(solution.x.head<3>()).toRotationMatrix() * m;
    }
    scan.solutions.push_back(std::move(solution));
    scan.mountings.push_back(m);
  }
  find_scan_minimum(scan);
  return scan;
}

ChangeNormal sum_without(const std::vector<ChangeNormal>& normals, std::size_t group,
                         std::size_t groups) {
  ChangeNormal sum;
  for (std::size_t i = 0; i < normals.size(); ++i) {
    if (i * groups / normals.size() == group) continue;
    sum.A += normals[i].A;
    sum.b += normals[i].b;
    sum.yy += normals[i].yy;
  }
  return sum;
}

// Standard errors of the entries of the free mounting matrix.
Matrix3d free_sigma(const ChangeSolution& solution) {
  const std::size_t groups = std::min(kGroups, solution.normals.size());
  std::vector<Eigen::VectorXd> left_out;
  left_out.reserve(groups);
  for (std::size_t g = 0; g < groups; ++g) {
    left_out.push_back(solve(sum_without(solution.normals, g, groups), free_model()).x);
  }
  Matrix3d sigma;
  for (Eigen::Index i = 0; i < 9; ++i) {
    std::vector<double> values;
    values.reserve(left_out.size());
    for (const Eigen::VectorXd& x : left_out) values.push_back(x(i));
    sigma(i % 3, i / 3) = jackknife_sigma(values);
  }
  return sigma;
}

// The orthogonal matrix nearest to the free mounting matrix; empty when it is not significant.
std::optional<Matrix3d> nearest_orthogonal(const ChangeSolution& solution) {
  const Matrix3d m = matrix_in(solution.x);
  const Eigen::JacobiSVD<Matrix3d> svd(m, Eigen::ComputeFullU | Eigen::ComputeFullV);
  const double sigma = free_sigma(solution).maxCoeff();
  if (!(svd.singularValues()(2) > 4.0 * sigma)) return std::nullopt;
  return Matrix3d(svd.matrixU() * svd.matrixV().transpose());
}

double angle_between(const Matrix3d& a, const Matrix3d& b) {
  return so3::angle_between(Eigen::Quaterniond(Matrix3d(a * b.transpose())),
                            Eigen::Quaterniond::Identity());
}

void set_sigmas(const Scan& scan, DvlImuFit& fit) {
  const std::size_t groups = std::min(kGroups, scan.solutions[scan.best.index].normals.size());
  std::vector<double> offsets;
  std::array<std::vector<double>, 6> numbers;
  for (std::size_t g = 0; g < groups; ++g) {
    std::vector<double> costs;
    std::vector<Eigen::VectorXd> xs;
    for (std::size_t i = 0; i < scan.offsets.size(); ++i) {
      const auto s =
          solve(sum_without(scan.solutions[i].normals, g, groups), rigid_model(scan.mountings[i]));
      costs.push_back(s.sum);
      xs.push_back(s.x);
    }
    const Minimum best = find_minimum(scan.offsets, costs);
    offsets.push_back(best.at);
    for (std::size_t k = 0; k < numbers.size(); ++k) {
      numbers[k].push_back(xs[best.index](static_cast<Eigen::Index>(k)));
    }
  }
  fit.time_offset_sigma_s = jackknife_sigma(offsets);
  for (std::size_t k = 0; k < 3; ++k) {
    fit.mounting_sigma(static_cast<Eigen::Index>(k)) = jackknife_sigma(numbers[k]);
    fit.lever_arm_sigma(static_cast<Eigen::Index>(k)) = jackknife_sigma(numbers[k + 3]);
  }
}

// Regression of the force change on the velocity change and vice versa, with all other unknowns
// eliminated: noise biases the first slope toward zero and the second away from it.
void set_scale(const ChangeSolution& solution, const Matrix3d& mounting, DvlImuFit& fit) {
  ChangeNormal sum;
  for (const ChangeNormal& n : solution.normals) {
    sum.A += n.A;
    sum.b += n.b;
    sum.yy += n.yy;
  }
  const ChangeModel model = rigid_model(mounting);
  const auto& N = model.basis;
  const Eigen::MatrixXd A = N.transpose() * sum.A * N + Eigen::MatrixXd(model.prior.asDiagonal());
  const Eigen::LDLT<Eigen::MatrixXd> other(A);
  const Eigen::VectorXd Nc = N.transpose() * sum.A * model.base;
  const Eigen::VectorXd Ny = N.transpose() * sum.b;
  const double cc = model.base.dot(sum.A * model.base) - Nc.dot(other.solve(Nc));
  const double cy = model.base.dot(sum.b) - Nc.dot(other.solve(Ny));
  const double yy = sum.yy - Ny.dot(other.solve(Ny));
  if (!(cc > 0.0 && cy > 0.0)) return;
  fit.scale_low = cy / cc;
  fit.scale_high = yy / cy;
}

std::size_t pairs_in(const std::vector<ChangeBlock>& blocks) {
  std::size_t pairs = 0;
  for (const ChangeBlock& block : blocks)
    pairs += static_cast<std::size_t>(block.force_change.size() / 3);
  return pairs;
}

}  // namespace

DvlMounting mounting_of(const Rig& rig) {
  if (!rig.dvl) return {};
  const Eigen::Matrix3d signs = rig.dvl->axis_signs.asDiagonal();
  return {rig.dvl->scale * rig.dvl->T_body_dvl.rotation.toRotationMatrix() * signs,
          rig.dvl->T_body_dvl.translation, rig.dvl->time_offset_s};
}

std::optional<DvlImuFit> fit_dvl_against_imu(const InertialPath& path,
                                             const std::vector<DvlPing>& pings,
                                             const DvlMounting& rig) {
  if (path.empty() || pings.size() < 2) return std::nullopt;
  const auto coarse = scan_free(path, pings);
  if (!coarse) return std::nullopt;
  const double scale = std::cbrt(std::abs(rig.matrix.determinant()));
  const Matrix3d given = rig.matrix / scale;
  const auto found = nearest_orthogonal(coarse->solutions[coarse->best.index]);
  DvlImuFit fit;
  Matrix3d start = given;
  if (found) {
    const bool reflected = found->determinant() * given.determinant() < 0.0;
    fit.mounting_is_observable = true;
    if (reflected || angle_between(*found, given) > kMaxMountingChange) start = *found;
  }
  const Scan fine = scan_rigid(path, pings, *coarse, scale * start);
  const ChangeSolution& best = fine.solutions[fine.best.index];
  fit.time_offset_s = fine.best.at;
  fit.mounting = fine.mountings[fine.best.index] / scale;
  fit.lever_arm = best.x.segment<3>(3);
  fit.rms = best.rms;
  set_sigmas(fine, fit);
  set_scale(best, fine.mountings[fine.best.index], fit);
  const auto with_rig = velocity_changes(path, pings, rig.time_offset_s, fine.spans);
  fit.rms_with_rig = solve(with_rig, rig_model(rig)).rms;
  fit.pairs = pairs_in(with_rig);
  return fit;
}

}  // namespace apvi::doctor
