// SPDX-License-Identifier: BSD-3-Clause
#include "runs/calibrate/calibration_combination.hpp"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <cmath>

#include "core/random.hpp"

namespace apvi::runs {
namespace {

using Eigen::MatrixXd;
using Eigen::VectorXd;

// What a window knows that measured `data` with this information, with its prior centered on the
// start.
DiveKnowledge knowledge(const CombinationInput& input, const MatrixXd& information,
                        const VectorXd& data) {
  const VectorXd prior = input.prior_sigma.array().square().inverse();
  const MatrixXd total = information + MatrixXd(prior.asDiagonal());
  const MatrixXd covariance = total.inverse();
  return {covariance * information * (data - input.start), covariance};
}

CombinationInput two_parameters() {
  return {.prior_sigma = Eigen::Vector3d(0.01, 0.02, 0.03),
          .start = VectorXd::Zero(3),
          .parameter = {0, 1, 1},
          .dives = {}};
}

MatrixXd correlated() {
  const Eigen::Matrix3d root{{2000.0, 300.0, 0.0}, {0.0, 800.0, -200.0}, {100.0, 0.0, 500.0}};
  return root.transpose() * root;
}

VectorXd draw(Random& random, const MatrixXd& covariance) {
  const Eigen::LLT<MatrixXd> root(covariance);
  VectorXd white(covariance.rows());
  for (double& value : white) value = random.normal();
  return root.matrixL() * white;
}

TEST(Combine, CountsThePriorOfTheRigOnce) {
  CombinationInput input = two_parameters();
  const MatrixXd a = correlated();
  const MatrixXd b = Eigen::Vector3d(1e6, 4e5, 3e5).asDiagonal();
  const Eigen::Vector3d data_a(0.011, -0.012, 0.02);
  const Eigen::Vector3d data_b(0.0111, -0.0122, 0.0202);
  input.dives = {knowledge(input, a, data_a), knowledge(input, b, data_b)};
  const VectorXd prior = input.prior_sigma.array().square().inverse();
  const MatrixXd total = a + b + MatrixXd(prior.asDiagonal());
  const VectorXd expected = total.inverse() * (a * data_a + b * data_b);
  const Combination found = combine(input);
  EXPECT_LT((found.change - expected).norm(), 1e-9);
  EXPECT_NEAR(found.sigma(1), std::sqrt(total.inverse()(1, 1)), 1e-9);
  EXPECT_EQ(found.observable, (std::vector<bool>{true, true, true}));
}

TEST(Combine, DoesNotDependOnTheCalibrationThatTheDivesWereRunWith) {
  CombinationInput input = two_parameters();
  const Eigen::Vector3d data(0.012, -0.008, 0.015);
  const auto from = [&](const Eigen::Vector3d& start) {
    input.start = start;
    input.dives = {knowledge(input, correlated(), data),
                   knowledge(input, 2.0 * correlated(), 1.01 * data)};
    return combine(input);
  };
  const Combination rig = from(Eigen::Vector3d::Zero());
  const Combination later = from({0.011, -0.009, 0.014});
  EXPECT_LT((rig.change - later.change).norm(), 1e-9);
  EXPECT_LT((rig.sigma - later.sigma).norm(), 1e-9);
}

TEST(Combine, KeepsWhatNoDiveObservesAtTheRigsValue) {
  CombinationInput input = two_parameters();
  const Eigen::Vector3d direction(1.0, 0.0, 1.0);  // only a sum of the first and the third is seen
  MatrixXd information = 1e8 * direction * direction.transpose();
  information(1, 1) = 1e6;
  input.prior_sigma = Eigen::Vector3d(0.01, 0.02, 0.01);
  const Eigen::Vector3d data(0.004, 0.01, 0.004);
  input.dives = {knowledge(input, information, data)};
  const Combination found = combine(input);
  EXPECT_EQ(found.observable, (std::vector<bool>{false, true, false}));
  EXPECT_EQ(found.change(0), 0.0);
  EXPECT_EQ(found.change(2), 0.0);
  EXPECT_NEAR(found.change(1), 0.01, 1e-4);
  EXPECT_TRUE(std::isnan(found.consistency[0]));
}

TEST(Combine, WeakensDivesThatDisagree) {
  CombinationInput input = two_parameters();
  const MatrixXd information = Eigen::Vector3d(1e8, 1e8, 1e8).asDiagonal();  // sigma 1e-4
  for (const double x : {0.004, 0.006}) {
    input.dives.push_back(knowledge(input, information, Eigen::Vector3d(x, 0.001, 0.002)));
  }
  const Combination found = combine(input);
  EXPECT_NEAR(found.consistency[0], 200.0, 2.0);  // (0.001 / 1e-4)² twice, one degree of freedom
  EXPECT_LT(found.consistency[1], 0.1);
  EXPECT_NEAR(found.sigma(0), 0.001, 5e-5);  // the error of a mean of two, from their spread
  EXPECT_NEAR(found.change(0), 0.005, 1e-4);
}

TEST(Combine, SigmasAreThoseOfTheErrors) {
  Random random(4711);
  const MatrixXd covariance = correlated().inverse();
  double squares = 0.0;
  double ratios = 0.0;
  constexpr int kDraws = 400;
  for (int k = 0; k < kDraws; ++k) {
    CombinationInput input = two_parameters();
    const VectorXd truth = draw(random, input.prior_sigma.array().square().matrix().asDiagonal());
    for (int dive = 0; dive < 4; ++dive) {
      // Errors are three times as large as the dives say.
      const VectorXd data = truth + 3.0 * draw(random, covariance);
      input.dives.push_back(knowledge(input, correlated(), data));
    }
    const Combination found = combine(input);
    squares += (found.change - truth).cwiseQuotient(found.sigma).squaredNorm() / 3.0;
    ratios += found.consistency[1];
  }
  EXPECT_NEAR(squares / kDraws, 1.0, 0.3);
  EXPECT_NEAR(ratios / kDraws, 9.0, 1.0);
}

}  // namespace
}  // namespace apvi::runs
