// SPDX-License-Identifier: BSD-3-Clause
#include "doctor/dvl_imu_fit.hpp"

#include <Eigen/Cholesky>
#include <Eigen/Geometry>
#include <Eigen/SVD>
#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include "apvi/geometry/so3.hpp"
#include "doctor/scan.hpp"
#include "doctor/velocity_changes.hpp"

namespace apvi::doctor {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

constexpr double kNear = 0.12;  // between the pings of a change of velocity [s]
constexpr double kFar = 0.9;    // the same [s]
constexpr double kReach = 1.0;  // of the scan over time offsets [s]
constexpr double kCoarse = 0.05;
constexpr double kFineReach = 0.1;  // of the second one
constexpr double kFine = 0.02;
constexpr std::size_t kFewestBlocks = 2;
// How much lower than the rest of the scan its minimum must be, to be a minimum of anything.
constexpr double kClearDip = 0.97;
constexpr std::size_t kGroups = 10;
constexpr double kTurned = 20.0 * std::numbers::pi / 180.0;

// What solutions of a scan have in common.
struct Scan {
  std::vector<double> offsets;
  std::vector<ChangeSolution> solutions;
  std::vector<Matrix3d> mountings;  // of each solution; constrained models only
  Minimum best;
  ChangeSpans spans;
  double dip = 1.0;  // rms at the minimum over the median of the scan
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
  model.prior.tail<3>().setConstant(
      1e-4);  // an accelerometer is good to a metre per second squared
  return model;
}

// Unknown: a small rotation (body side), lever arm, accelerometer bias.
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

ChangeModel given_model(const DvlMounting& rig) {
  ChangeModel model;
  model.base = as_vector(rig.matrix);
  model.base.segment<3>(kLever) = rig.lever_arm;
  model.basis = Eigen::MatrixXd::Zero(kChangeSize, 3);
  model.basis.bottomRows<3>().setIdentity();
  model.prior = free_model().prior.tail<3>();
  return model;
}

void find_best(Scan& scan) {
  std::vector<double> costs;
  costs.reserve(scan.solutions.size());
  for (const ChangeSolution& s : scan.solutions) costs.push_back(s.rms * s.rms);
  scan.best = lowest(scan.offsets, costs);
}

std::optional<Scan> scan_free(const InertialPath& path, const std::vector<DvlPing>& pings,
                              const ChangeSpans& spans) {
  Scan scan;
  scan.spans = spans;
  scan.offsets = steps(-kReach, kReach, kCoarse);
  std::vector<double> rms;
  for (const double offset : scan.offsets) {
    const auto blocks = velocity_changes(path, pings, offset, spans);
    if (blocks.size() < kFewestBlocks) return std::nullopt;
    scan.solutions.push_back(solve(blocks, free_model()));
    rms.push_back(scan.solutions.back().rms);
  }
  find_best(scan);
  const auto middle = rms.begin() + static_cast<std::ptrdiff_t>(rms.size() / 2);
  std::nth_element(rms.begin(), middle, rms.end());
  scan.dip = std::sqrt(std::max(0.0, scan.best.value)) / std::max(1e-12, *middle);
  if (!scan.best.inside || scan.dip > kClearDip) return std::nullopt;
  return scan;
}

// From ping to ping the accelerometer is at its best, over a second the DVL is: the one that tells
// the time offset more clearly serves.
std::optional<Scan> scan_free(const InertialPath& path, const std::vector<DvlPing>& pings) {
  const double span = path.seconds(pings.back().stamp) - path.seconds(pings.front().stamp);
  const double block = std::clamp(span / 4.0, 5.0, 20.0);
  auto near = scan_free(path, pings, {.shortest_s = kNear, .block_s = block});
  auto far = scan_free(path, pings, {.shortest_s = kFar, .block_s = block});
  if (!far) return near;
  return near && near->dip < far->dip ? near : far;
}

Scan scan_rigid(const InertialPath& path, const std::vector<DvlPing>& pings, const Scan& coarse,
                const Matrix3d& mounting) {
  Scan scan;
  scan.spans = coarse.spans;
  const double around = coarse.best.at;
  scan.offsets = steps(around - kFineReach, around + kFineReach, kFine);
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
  find_best(scan);
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

// Standard errors of the free mounting matrix's numbers.
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

// The orthogonal matrix nearest to a mounting matrix; nothing when that is lost in its noise.
std::optional<Matrix3d> clean_mounting(const ChangeSolution& solution) {
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
    const Minimum best = lowest(scan.offsets, costs);
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

// Regression of what is felt on the velocity's change and the other way round, everything else
// eliminated: noise pulls the first towards zero and the second away from it.
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
  for (const ChangeBlock& block : blocks) pairs += static_cast<std::size_t>(block.felt.size() / 3);
  return pairs;
}

}  // namespace

std::optional<DvlImuFit> fit_dvl_against_imu(const InertialPath& path,
                                             const std::vector<DvlPing>& pings,
                                             const DvlMounting& rig) {
  if (path.empty() || pings.size() < 2) return std::nullopt;
  const auto coarse = scan_free(path, pings);
  if (!coarse) return std::nullopt;
  const double scale = std::cbrt(std::abs(rig.matrix.determinant()));
  const Matrix3d given = rig.matrix / scale;
  const auto found = clean_mounting(coarse->solutions[coarse->best.index]);
  DvlImuFit fit;
  Matrix3d start = given;
  if (found) {
    const bool reflected = found->determinant() * given.determinant() < 0.0;
    fit.mounting_is_free = true;
    if (reflected || angle_between(*found, given) > kTurned) start = *found;
  }
  const Scan fine = scan_rigid(path, pings, *coarse, scale * start);
  const ChangeSolution& best = fine.solutions[fine.best.index];
  fit.time_offset_s = fine.best.at;
  fit.mounting = fine.mountings[fine.best.index] / scale;
  fit.lever_arm = best.x.segment<3>(3);
  fit.rms = best.rms;
  set_sigmas(fine, fit);
  set_scale(best, fine.mountings[fine.best.index], fit);
  const auto as_rig = velocity_changes(path, pings, rig.time_offset_s, fine.spans);
  fit.rms_as_rig = solve(as_rig, given_model(rig)).rms;
  fit.pairs = pairs_in(as_rig);
  return fit;
}

}  // namespace apvi::doctor
