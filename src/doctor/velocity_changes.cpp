// SPDX-License-Identifier: BSD-3-Clause
#include "doctor/velocity_changes.hpp"

#include <Eigen/Cholesky>
#include <Eigen/QR>
#include <algorithm>
#include <cmath>

#include "apvi/geometry/so3.hpp"
#include "core/median.hpp"

namespace apvi::doctor {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;
using Row = Eigen::Matrix<double, 3, kChangeSize>;

constexpr double kMaxSpan = 2.6;  // maximum, between the pings of a change [s]
constexpr Eigen::Index kMinChangesPerBlock = 5;
constexpr int kReweightings = 4;

// Quantities at one ping's corrected time, in the frame "start".
struct PingState {
  double t = 0.0;
  Matrix3d R;
  Row velocity;  // Jacobian of the IMU velocity, which is linear in the unknowns
  Vector3d force_change;
};

std::optional<PingState> ping_state(const InertialPath& path, const DvlPing& ping,
                                    double offset_s) {
  const double t = path.seconds(ping.stamp) - offset_s;
  const auto state = path.at(t);
  const auto rate = path.rate_at(t);
  if (!state || !rate) return std::nullopt;
  PingState now{t, state->R_start_body.toRotationMatrix(), Row::Zero(), state->force_integral};
  for (int j = 0; j < 3; ++j) {
    now.velocity.block<3, 3>(0, kMounting + 3 * j) = ping.velocity(j) * now.R;
  }
  now.velocity.block<3, 3>(0, kLever) = -now.R * so3::hat(*rate);
  // A bias b adds ∫R b dt to the force change, moved here to the side of the velocity change.
  now.velocity.block<3, 3>(0, kAccelBias) = state->rotation_integral;
  return now;
}

std::vector<PingState> ping_states(const InertialPath& path, const std::vector<DvlPing>& pings,
                                   double offset_s) {
  std::vector<PingState> result;
  for (const DvlPing& ping : pings) {
    if (auto now = ping_state(path, ping, offset_s)) result.push_back(std::move(*now));
  }
  return result;
}

struct Pair {
  const PingState* from;
  const PingState* to;
};

std::vector<Pair> pairs_of(const InertialPath& path, const std::vector<PingState>& all,
                           double shortest_s) {
  std::vector<Pair> pairs;
  std::size_t j = 0;
  for (const PingState& from : all) {
    while (j < all.size() && all[j].t < from.t + shortest_s) ++j;
    if (j == all.size()) break;
    if (all[j].t > from.t + kMaxSpan || !path.is_continuous(from.t, all[j].t)) continue;
    pairs.push_back({&from, &all[j]});
  }
  return pairs;
}

ChangeBlock make_block(const Pair* begin, const Pair* end, double block_s) {
  const auto n = static_cast<Eigen::Index>(end - begin);
  ChangeBlock block;
  block.unknowns.resize(3 * n, kChangeSize);
  block.gravity.resize(3 * n, 6);
  block.force_change.resize(3 * n);
  const double middle = 0.5 * (begin->from->t + (end - 1)->to->t);
  for (Eigen::Index i = 0; i < n; ++i) {
    const Pair& pair = begin[i];
    const double dt = pair.to->t - pair.from->t;
    const double late = (0.5 * (pair.from->t + pair.to->t) - middle) / block_s;
    block.unknowns.middleRows<3>(3 * i) = pair.to->velocity - pair.from->velocity;
    block.gravity.block<3, 3>(3 * i, 0) = dt * Matrix3d::Identity();
    block.gravity.block<3, 3>(3 * i, 3) = dt * late * Matrix3d::Identity();
    block.force_change.segment<3>(3 * i) = pair.to->force_change - pair.from->force_change;
  }
  return block;
}

// Weights of the changes of a block, one per change.
using Weights = Eigen::VectorXd;

Eigen::VectorXd root_per_row(const Weights& weights) {
  Eigen::VectorXd root(3 * weights.size());
  for (Eigen::Index i = 0; i < root.size(); ++i) root(i) = std::sqrt(weights(i / 3));
  return root;
}

// Projects out everything that gravity can explain.
Eigen::MatrixXd without_gravity(const ChangeBlock& block, const Eigen::VectorXd& root,
                                const Eigen::MatrixXd& columns) {
  const Eigen::MatrixXd gravity = root.asDiagonal() * block.gravity;
  const Eigen::MatrixXd weighted = root.asDiagonal() * columns;
  const Eigen::HouseholderQR<Eigen::MatrixXd> qr(gravity);
  const Eigen::MatrixXd q =
      qr.householderQ() * Eigen::MatrixXd::Identity(gravity.rows(), gravity.cols());
  return weighted - q * (q.transpose() * weighted);
}

ChangeNormal reduce(const ChangeBlock& block, const Weights& weights) {
  Eigen::MatrixXd columns(block.force_change.size(), kChangeSize + 1);
  columns << block.unknowns, block.force_change;
  const Eigen::MatrixXd clean = without_gravity(block, root_per_row(weights), columns);
  const auto X = clean.leftCols(kChangeSize);
  const auto y = clean.col(kChangeSize);
  return {X.transpose() * X, X.transpose() * y, y.squaredNorm()};
}

// Residual norm of every change of a block.
Eigen::VectorXd lengths(const ChangeBlock& block, const Weights& weights,
                        const ChangeVector& unknowns) {
  const Eigen::VectorXd root = root_per_row(weights);
  const Eigen::VectorXd rest = block.force_change - block.unknowns * unknowns;
  const Eigen::VectorXd clean = without_gravity(block, root, rest);
  Eigen::VectorXd result(weights.size());
  for (Eigen::Index i = 0; i < weights.size(); ++i) {
    result(i) = clean.segment<3>(3 * i).norm() / std::max(1e-9, root(3 * i));
  }
  return result;
}

ChangeNormal total(const std::vector<ChangeNormal>& normals) {
  ChangeNormal sum;
  for (const ChangeNormal& n : normals) {
    sum.A += n.A;
    sum.b += n.b;
    sum.yy += n.yy;
  }
  return sum;
}

double huber_rms(const std::vector<Eigen::VectorXd>& residuals, double limit) {
  double sum = 0.0;
  double count = 0.0;
  for (const Eigen::VectorXd& block : residuals) {
    for (const double r : block) sum += r < limit ? r * r : 2.0 * limit * r - limit * limit;
    count += static_cast<double>(block.size());
  }
  return std::sqrt(sum / std::max(1.0, count));
}

}  // namespace

std::vector<ChangeBlock> velocity_changes(const InertialPath& path,
                                          const std::vector<DvlPing>& pings, double offset_s,
                                          const ChangeSpans& spans) {
  const std::vector<PingState> all = ping_states(path, pings, offset_s);
  const std::vector<Pair> pairs = pairs_of(path, all, spans.shortest_s);
  std::vector<ChangeBlock> blocks;
  const auto span_of = [&spans](const Pair& pair) {
    return std::floor(pair.from->t / spans.block_s);
  };
  for (std::size_t i = 0; i < pairs.size();) {
    std::size_t end = i;
    while (end < pairs.size() && span_of(pairs[end]) == span_of(pairs[i])) ++end;
    if (static_cast<Eigen::Index>(end - i) >= kMinChangesPerBlock) {
      blocks.push_back(make_block(pairs.data() + i, pairs.data() + end, spans.block_s));
    }
    i = end;
  }
  return blocks;
}

ChangeSolution solve(const ChangeNormal& normal, const ChangeModel& model) {
  const Eigen::MatrixXd A = model.basis.transpose() * normal.A * model.basis;
  const Eigen::VectorXd b = model.basis.transpose() * (normal.b - normal.A * model.base);
  ChangeSolution solution;
  solution.x = (A + Eigen::MatrixXd(model.prior.asDiagonal())).ldlt().solve(b);
  if (!solution.x.allFinite()) solution.x.setZero();
  const ChangeVector u = model.base + model.basis * solution.x;
  solution.sum = std::max(0.0, normal.yy - 2.0 * normal.b.dot(u) + u.dot(normal.A * u));
  return solution;
}

ChangeSolution solve(const std::vector<ChangeBlock>& blocks, const ChangeModel& model) {
  std::vector<Weights> weights;
  weights.reserve(blocks.size());
  for (const ChangeBlock& b : blocks)
    weights.emplace_back(Weights::Ones(b.force_change.size() / 3));
  ChangeSolution solution;
  for (int round = 0; round < kReweightings; ++round) {
    std::vector<ChangeNormal> normals;
    for (std::size_t i = 0; i < blocks.size(); ++i)
      normals.push_back(reduce(blocks[i], weights[i]));
    solution = solve(total(normals), model);
    solution.normals = std::move(normals);
    const ChangeVector u = model.base + model.basis * solution.x;
    std::vector<Eigen::VectorXd> residuals;
    std::vector<double> all;
    for (std::size_t i = 0; i < blocks.size(); ++i) {
      residuals.push_back(lengths(blocks[i], weights[i], u));
      all.insert(all.end(), residuals.back().begin(), residuals.back().end());
    }
    if (all.empty()) return solution;
    const double limit = std::max(1e-6, 2.5 * median(std::move(all)));
    solution.rms = huber_rms(residuals, limit);
    for (std::size_t i = 0; i < blocks.size(); ++i) {
      weights[i] = (limit / residuals[i].array().max(limit)).matrix();
    }
  }
  return solution;
}

}  // namespace apvi::doctor
