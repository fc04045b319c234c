// SPDX-License-Identifier: BSD-3-Clause
#include "runs/calibrate/calibration_combination.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <numeric>

namespace apvi::runs {
namespace {

using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr double kObservable = 0.5;  // of the prior's sigma, as CalibrationParameter::observable

/// A dive's information without the prior's.
struct Information {
  MatrixXd matrix;      // positive semidefinite
  MatrixXd covariance;  // with the prior
  VectorXd change;      // the dive's, with the prior centered on the start
};

// Rounding and linearization at different points leave negative eigenvalues where nothing is known.
Information without_prior(const DiveKnowledge& dive, const VectorXd& prior_sigma) {
  const auto scale = prior_sigma.asDiagonal();
  const auto size = prior_sigma.size();
  const MatrixXd total = dive.covariance.ldlt().solve(MatrixXd::Identity(size, size));
  const MatrixXd symmetric = 0.5 * (total + total.transpose());
  const MatrixXd scaled = scale * symmetric * scale - MatrixXd::Identity(size, size);
  const Eigen::SelfAdjointEigenSolver<MatrixXd> eigen(scaled);
  const VectorXd values = eigen.eigenvalues().cwiseMax(0.0);
  const auto& vectors = eigen.eigenvectors();
  const auto inverse = prior_sigma.cwiseInverse().asDiagonal();
  const VectorXd shrunk = (values.array() + 1.0).inverse();
  return {inverse * vectors * values.asDiagonal() * vectors.transpose() * inverse,
          scale * vectors * shrunk.asDiagonal() * vectors.transpose() * scale, dive.change};
}

/// Mean squares of residuals, in total and by parameter.
struct Consistency {
  double all = 0.0;
  std::vector<double> parameters;
};

class Combiner {
 public:
  explicit Combiner(const CombinationInput& input) : input_(input) {
    for (const DiveKnowledge& dive : input.dives) {
      dives_.push_back(without_prior(dive, input.prior_sigma));
    }
  }

  Combination combine() const {
    Combination result = solve(1.0, {});
    const Consistency found = consistency(result.change);
    const double factor = found.all > 1.0 ? found.all : 1.0;  // not for NaN
    result = solve(factor, found.parameters);
    result.consistency = found.parameters;
    return result;
  }

 private:
  // With the information of the dives divided by `factor`. A prior centered on the start says
  // nothing about the difference to it: what a dive measured is its information times (change of
  // its data), which is its total information times its change.
  Combination solve(double factor, const std::vector<double>& consistency) const {
    const VectorXd prior = input_.prior_sigma.array().square().inverse();
    MatrixXd information = prior.asDiagonal();
    VectorXd vector = VectorXd::Zero(prior.size());
    for (const Information& dive : dives_) {
      const VectorXd measured =
          dive.matrix * (dive.change + input_.start) + prior.cwiseProduct(dive.change);
      information += dive.matrix / factor;
      vector += measured / factor;
    }
    const MatrixXd covariance =
        information.ldlt().solve(MatrixXd::Identity(prior.size(), prior.size()));
    Combination result;
    result.sigma = covariance.diagonal().cwiseSqrt();
    widen(result.sigma, factor, consistency);
    for (Eigen::Index c = 0; c < prior.size(); ++c) {
      result.observable.push_back(result.sigma(c) < kObservable * input_.prior_sigma(c));
    }
    result.change = conditional(information, vector, result.observable);
    return result;
  }

  // The sigma of a parameter that is less consistent than the others.
  void widen(VectorXd& sigma, double factor, const std::vector<double>& consistency) const {
    if (consistency.empty()) return;
    for (Eigen::Index c = 0; c < sigma.size(); ++c) {
      const double own = consistency[parameter(c)];
      if (own > factor) sigma(c) *= std::sqrt(own / factor);
      sigma(c) = std::min(sigma(c), input_.prior_sigma(c));
    }
  }

  static VectorXd conditional(const MatrixXd& information, const VectorXd& vector,
                              const std::vector<bool>& observable) {
    std::vector<Eigen::Index> free;
    for (std::size_t c = 0; c < observable.size(); ++c) {
      if (observable[c]) free.push_back(static_cast<Eigen::Index>(c));
    }
    VectorXd change = VectorXd::Zero(vector.size());
    const MatrixXd part = information(free, free);
    const VectorXd side = vector(free);
    const VectorXd solution = part.ldlt().solve(side);
    change(free) = solution;
    return change;
  }

  // The change of a dive is a fraction of the truth's, as the prior pulls it to the start.
  Consistency consistency(const VectorXd& change) const {
    std::vector<double> sums(parameters(), 0.0);
    std::vector<int> counts(parameters(), 0);
    for (Eigen::Index c = 0; c < change.size(); ++c) {
      std::vector<double> squares;
      for (const Information& dive : dives_) {
        if (std::sqrt(dive.covariance(c, c)) >= kObservable * input_.prior_sigma(c)) continue;
        const VectorXd gain = dive.matrix * dive.covariance.col(c);
        const double expected = gain.dot(change - input_.start);
        const double variance = dive.covariance.col(c).dot(gain);
        squares.push_back(std::pow(dive.change(c) - expected, 2) / variance);
      }
      if (squares.size() < 2) continue;
      sums[parameter(c)] += std::accumulate(squares.begin(), squares.end(), 0.0);
      counts[parameter(c)] += static_cast<int>(squares.size()) - 1;
    }
    return means(sums, counts);
  }

  static Consistency means(const std::vector<double>& sums, const std::vector<int>& counts) {
    Consistency found;
    double sum = 0.0;
    int count = 0;
    for (std::size_t p = 0; p < sums.size(); ++p) {
      found.parameters.push_back(sums[p] / counts[p]);  // NaN without any
      sum += sums[p];
      count += counts[p];
    }
    found.all = sum / count;
    return found;
  }

  std::size_t parameter(Eigen::Index component) const {
    return static_cast<std::size_t>(input_.parameter[static_cast<std::size_t>(component)]);
  }
  std::size_t parameters() const {
    return input_.parameter.empty() ? 0U : static_cast<std::size_t>(input_.parameter.back()) + 1U;
  }

  const CombinationInput& input_;
  std::vector<Information> dives_;
};

}  // namespace

Combination combine(const CombinationInput& input) {
  return Combiner(input).combine();
}

}  // namespace apvi::runs
