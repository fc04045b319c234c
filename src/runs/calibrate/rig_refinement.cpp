// SPDX-License-Identifier: BSD-3-Clause
#include <numeric>
#include <optional>
#include <utility>

#include "apvi/core/error.hpp"
#include "apvi/core/log.hpp"
#include "runs/calibrate/calibration_combination.hpp"
#include "runs/calibrate/rig_calibration.hpp"
#include "runs/calibrate/rig_components.hpp"
#include "runs/calibrate/self_calibration.hpp"

namespace apvi::runs {
namespace {

using Eigen::VectorXd;
using vio::CalibrationParameter;

constexpr int kMaxRounds = 3;

VectorXd stacked(const std::vector<CalibrationParameter>& parameters,
                 VectorXd CalibrationParameter::*member) {
  std::vector<double> all;
  for (const CalibrationParameter& p : parameters) {
    all.insert(all.end(), (p.*member).begin(), (p.*member).end());
  }
  return Eigen::Map<const VectorXd>(all.data(), static_cast<Eigen::Index>(all.size()));
}

std::vector<CalibrationParameter> with_change(std::vector<CalibrationParameter> parameters,
                                              const VectorXd& change) {
  Eigen::Index first = 0;
  for (CalibrationParameter& p : parameters) {
    p.change = change.segment(first, p.change.size());
    first += p.change.size();
  }
  return parameters;
}

class Refinement {
 public:
  Refinement(const config::Node& rig, const std::vector<std::string>& names,
             const LocalizeDive& localize)
      : node_(rig), rig_(make_rig(rig)), names_(names), localize_(localize), used_(names.size()) {
    std::iota(used_.begin(), used_.end(), std::size_t{0});
    result_.rig = rig;
  }

  RigCalibration run() && {
    while (!result_.settled && result_.rounds < kMaxRounds) {
      ++result_.rounds;
      improve(localize_all());
    }
    for (const std::size_t dive : used_) result_.dives.push_back(names_[dive]);
    return std::move(result_);
  }

 private:
  std::vector<DiveKnowledge> localize_all() {
    std::vector<DiveKnowledge> found;
    std::vector<std::size_t> used;
    for (const std::size_t dive : used_) {
      log::info("round {} of at most {}, dive {} of {}: {}", result_.rounds, kMaxRounds, dive + 1,
                names_.size(), names_[dive]);
      if (auto knowledge = localize(dive)) {
        found.push_back(std::move(*knowledge));
        used.push_back(dive);
      }
    }
    used_ = std::move(used);
    if (used_.empty()) {
      fail_run("no dive could be used for the calibration: {}", result_.left_out.back());
    }
    return found;
  }

  std::optional<DiveKnowledge> localize(std::size_t dive) {
    std::optional<vio::CalibrationEstimate> found;
    try {
      found = localize_(dive, result_.rig, result_.rounds);
      if (found) return knowledge(*found);
    } catch (const RunError& e) {
      result_.left_out.push_back(names_[dive] + ": " + e.what());
      log::warning("left out: {}", result_.left_out.back());
      return std::nullopt;
    }
    fail_run("interrupted; no rig was written");
  }

  DiveKnowledge knowledge(const vio::CalibrationEstimate& found) {
    if (found.parameters.empty()) fail_run("no image could be used, or nothing is estimated");
    if (parameters_.empty()) begin(found.parameters);
    VectorXd change = stacked(found.parameters, &CalibrationParameter::change);
    if (change.size() != change_.size()) fail_run("its sensors are not those of the others");
    return {std::move(change), found.covariance};
  }

  void begin(const std::vector<CalibrationParameter>& parameters) {
    parameters_ = parameters;
    change_ = VectorXd::Zero(stacked(parameters, &CalibrationParameter::change).size());
  }

  void improve(std::vector<DiveKnowledge> dives) {
    CombinationInput input{.prior_sigma = prior_sigma(),
                           .start = change_,
                           .parameter = parameter_of_components(),
                           .dives = std::move(dives)};
    const Combination found = combine(input);
    const VectorXd moved = (found.change - change_).cwiseQuotient(found.sigma).cwiseAbs();
    result_.settled = moved.maxCoeff() <= 1.0;
    change_ = found.change;
    const Rig now = changed(rig_, with_change(parameters_, change_));
    result_.rig = estimated_rig(node_, now);
    result_.components = components(rig_, parameters_, input, found);
    log::info("round {}: the largest change is {:.1f} standard deviations", result_.rounds,
              moved.maxCoeff());
  }

  VectorXd prior_sigma() const {
    VectorXd sigma(change_.size());
    Eigen::Index first = 0;
    for (const CalibrationParameter& p : parameters_) {
      sigma.segment(first, p.change.size()).setConstant(p.prior_sigma);
      first += p.change.size();
    }
    return sigma;
  }

  std::vector<int> parameter_of_components() const {
    std::vector<int> indices;
    for (std::size_t k = 0; k < parameters_.size(); ++k) {
      const auto count = static_cast<std::size_t>(parameters_[k].change.size());
      indices.insert(indices.end(), count, static_cast<int>(k));
    }
    return indices;
  }

  config::Node node_;
  Rig rig_;
  const std::vector<std::string>& names_;
  const LocalizeDive& localize_;
  std::vector<std::size_t> used_;
  std::vector<CalibrationParameter> parameters_;  // names and sizes, of the first dive
  VectorXd change_;                               // from the rig, of all rounds
  RigCalibration result_;
};

}  // namespace

RigCalibration refine_rig(const config::Node& rig, const std::vector<std::string>& dives,
                          const LocalizeDive& localize) {
  return Refinement(rig, dives, localize).run();
}

}  // namespace apvi::runs
