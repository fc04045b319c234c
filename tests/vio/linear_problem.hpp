// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <memory>
#include <set>
#include <vector>

#include "core/random.hpp"
#include "vio/factors/factors.hpp"
#include "vio/marginalization/marginalization.hpp"

/// Least-squares problems that are linear in the tangent, solved with dense matrices: the reference
/// for marginalization.
namespace apvi::vio::test {

inline Eigen::MatrixXd random_matrix(Random& random, Eigen::Index rows, Eigen::Index cols) {
  Eigen::MatrixXd m(rows, cols);
  for (double& x : m.reshaped()) x = random.normal(0.0, 1.0);
  return m;
}

class LinearProblem {
 public:
  struct Term {
    std::shared_ptr<Prior> content;
    std::shared_ptr<PriorFactor> cost;
    std::vector<Block> blocks;
  };

  explicit LinearProblem(std::uint64_t seed) : random(seed) {}

  double* add_block(int size) {
    auto values = std::make_unique<std::vector<double>>(static_cast<std::size_t>(size));
    for (double& v : *values) v = random.normal(0.0, 1.0);
    if (size == 7) Eigen::Map<Eigen::Vector4d>(values->data() + 3).normalize();
    Block block{values->data(), size};
    first_column_.push_back(columns());
    blocks_.push_back(block);
    storage_.push_back(std::move(values));
    return block.data;
  }
  void add_term(const std::vector<double*>& data, const Eigen::MatrixXd& J) {
    auto prior = std::make_shared<Prior>();
    prior->J = J;
    prior->r = random_matrix(random, J.rows(), 1);
    Term term{.content = prior, .cost = nullptr, .blocks = {}};
    for (double* d : data) {
      const Block& block = blocks_[index(d)];
      term.blocks.push_back(block);
      prior->kept.push_back({block, std::vector<double>(d, d + block.size)});
    }
    term.cost = std::make_shared<PriorFactor>(prior);
    terms.push_back(std::move(term));
  }
  /// A term with Gaussian random Jacobians.
  void add_random_term(const std::vector<double*>& data, int rows) {
    Eigen::Index n = 0;
    for (const double* d : data) n += blocks_[index(d)].tangent();
    add_term(data, random_matrix(random, rows, n));
  }
  /// A term linearized from `term`.
  void add_prior(const Prior& prior) {
    auto content = std::make_shared<Prior>(prior);
    Term term{.content = content, .cost = std::make_shared<PriorFactor>(content), .blocks = {}};
    for (const auto& kept : prior.kept) term.blocks.push_back(kept.block);
    terms.push_back(std::move(term));
  }

  Eigen::Index columns() const {
    return blocks_.empty() ? 0 : first_column_.back() + blocks_.back().tangent();
  }
  Eigen::Index column(const double* data) const { return first_column_[index(data)]; }
  const Block& block(const double* data) const { return blocks_[index(data)]; }

  /// [H b] of all terms, by all blocks.
  Eigen::MatrixXd normal_equations() const {
    const Eigen::Index n = columns();
    Eigen::MatrixXd Hb = Eigen::MatrixXd::Zero(n, n + 1);
    for (const Term& term : terms) {
      Eigen::MatrixXd J = Eigen::MatrixXd::Zero(term.content->r.size(), n);
      Eigen::Index from = 0;
      for (const Block& b : term.blocks) {
        J.middleCols(column(b.data), b.tangent()) += term.content->J.middleCols(from, b.tangent());
        from += b.tangent();
      }
      Hb.leftCols(n) += J.transpose() * J;
      Hb.col(n) += J.transpose() * term.content->r;
    }
    return Hb;
  }
  /// The step to the minimum; zero for blocks without terms.
  Eigen::VectorXd solution() const {
    const Eigen::MatrixXd Hb = normal_equations();
    const Eigen::Index n = columns();
    return -Hb.leftCols(n).completeOrthogonalDecomposition().solve(Hb.col(n));
  }

  /// Moves the terms of the given blocks to the linearizer.
  void move_terms(const std::vector<double*>& touching, Linearizer& to) {
    const std::set<double*> wanted(touching.begin(), touching.end());
    std::vector<Term> left;
    for (Term& term : terms) {
      bool touches = false;
      for (const Block& b : term.blocks) touches = touches || wanted.contains(b.data);
      if (touches) {
        to.add(*term.cost, nullptr, term.blocks);
      } else {
        left.push_back(std::move(term));
      }
    }
    terms = std::move(left);
  }

  Random random;
  std::vector<Term> terms;

 private:
  std::size_t index(const double* data) const {
    std::size_t i = 0;
    while (blocks_[i].data != data) ++i;
    return i;
  }

  std::vector<std::unique_ptr<std::vector<double>>> storage_;
  std::vector<Block> blocks_;
  std::vector<Eigen::Index> first_column_;
};

/// A window of consecutive frames with landmarks observed by all.
struct LinearWindow {
  LinearProblem problem;
  std::vector<double*> poses, motions, landmarks;

  LinearWindow(std::uint64_t seed, int frames, int points) : problem(seed) {
    for (int k = 0; k < frames; ++k) {
      poses.push_back(problem.add_block(7));
      motions.push_back(problem.add_block(9));
    }
    problem.add_random_term({poses[0], motions[0]}, 15);
    for (std::size_t k = 1; k < poses.size(); ++k) {
      problem.add_random_term({poses[k - 1], motions[k - 1], poses[k], motions[k]}, 15);
    }
    for (int l = 0; l < points; ++l) {
      landmarks.push_back(problem.add_block(1));
      const std::size_t anchor = static_cast<std::size_t>(l) % poses.size();
      for (std::size_t k = 0; k < poses.size(); ++k) {
        if (k != anchor) problem.add_random_term({poses[anchor], poses[k], landmarks.back()}, 2);
      }
    }
  }
};

}  // namespace apvi::vio::test
