// SPDX-License-Identifier: BSD-3-Clause
#include "vio/window/calibration.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <utility>

#include "apvi/geometry/so3.hpp"

namespace apvi::vio {
namespace {

constexpr Duration kMemoryInterval{5'000'000'000};

// Of a component of a pose that is not estimated while the other is.
constexpr double kFixedSigma = 1e-6;

double sigma_of(const CalibrationPrior& prior) {
  return prior.estimate ? prior.sigma : kFixedSigma;
}

bool is_known(const Prior& knowledge, const double* data) {
  return std::ranges::any_of(knowledge.kept,
                             [&](const Prior::Kept& kept) { return kept.block.data == data; });
}

/// Adds blocks with independent errors to a prior.
class PriorBuilder {
 public:
  void add(Block block, const Eigen::VectorXd& sigmas) {
    prior_.kept.push_back({block, {block.data, block.data + block.size}});
    sigmas_.insert(sigmas_.end(), sigmas.begin(), sigmas.end());
  }
  Prior build() && {
    const auto size = static_cast<Eigen::Index>(sigmas_.size());
    prior_.J = Eigen::Map<const Eigen::VectorXd>(sigmas_.data(), size).cwiseInverse().asDiagonal();
    prior_.r = Eigen::VectorXd::Zero(size);
    return std::move(prior_);
  }

 private:
  Prior prior_;
  std::vector<double> sigmas_;
};

Eigen::VectorXd pose_sigmas(const CalibrationPrior& mounting, const CalibrationPrior& lever_arm) {
  Eigen::VectorXd sigmas(kPoseTangent);
  sigmas << Eigen::Vector3d::Constant(sigma_of(mounting)),
      Eigen::Vector3d::Constant(sigma_of(lever_arm));
  return sigmas;
}

Eigen::VectorXd lens_sigmas(const CalibrationConfig& config) {
  return Eigen::Vector3d(sigma_of(config.focal_length), sigma_of(config.principal_point),
                         sigma_of(config.principal_point));
}

/// Reads changes and standard deviations of parameters.
class ParameterReader {
 public:
  explicit ParameterReader(const Prior& knowledge) : knowledge_(knowledge) {
    covariance_ = (knowledge.J.transpose() * knowledge.J)
                      .ldlt()
                      .solve(Eigen::MatrixXd::Identity(knowledge.J.cols(), knowledge.J.cols()));
    step_ = -covariance_ * (knowledge.J.transpose() * knowledge.r);
  }
  /// Part of a block: `change` are the components from `first` on.
  void add(const std::string& name, const double* block, int first, const Eigen::VectorXd& change,
           const CalibrationPrior& prior) {
    if (!prior.estimate) return;
    int column = first;
    for (const Prior::Kept& kept : knowledge_.kept) {
      if (kept.block.data == block) break;
      column += kept.block.tangent();
    }
    if (column + change.size() > covariance_.cols()) return;
    const Eigen::VectorXd sigma =
        covariance_.diagonal().segment(column, change.size()).cwiseMax(0.0).cwiseSqrt();
    const Eigen::VectorXd estimate = change + step_.segment(column, change.size());
    found_.parameters.push_back(
        {.name = name, .change = estimate, .sigma = sigma, .prior_sigma = prior.sigma});
    for (int k = 0; k < change.size(); ++k) columns_.push_back(column + k);
  }
  void add_pose(const std::string& sensor, const PoseBlock& block, const SE3& rig,
                const CalibrationPrior& mounting, const CalibrationPrior& lever_arm) {
    const SE3 now = to_se3(block.data());
    add(sensor + ".mounting", block.data(), 0, so3::log(rig.rotation.conjugate() * now.rotation),
        mounting);
    add(sensor + ".lever_arm", block.data(), 3, now.translation - rig.translation, lever_arm);
  }
  CalibrationEstimate take() {
    found_.covariance = covariance_(columns_, columns_);
    return std::move(found_);
  }

 private:
  const Prior& knowledge_;
  Eigen::MatrixXd covariance_;
  Eigen::VectorXd step_;  // from the values in use to the estimate
  CalibrationEstimate found_;
  std::vector<int> columns_;  // of the covariance, by component
};

Eigen::VectorXd scalar(double value) {
  return Eigen::VectorXd::Constant(1, value);
}

const Eigen::VectorXd* change_of(const std::vector<CalibrationParameter>& parameters,
                                 const std::string& name) {
  const auto found = std::ranges::find(parameters, name, &CalibrationParameter::name);
  return found == parameters.end() ? nullptr : &found->change;
}

void change_pose(PoseBlock& block, const std::string& sensor,
                 const std::vector<CalibrationParameter>& parameters) {
  SE3 pose = to_se3(block.data());
  if (const auto* turn = change_of(parameters, sensor + ".mounting")) {
    pose.rotation *= so3::exp(Eigen::Vector3d(*turn));
  }
  if (const auto* shift = change_of(parameters, sensor + ".lever_arm")) pose.translation += *shift;
  block = to_block(pose);
}

}  // namespace

Calibration calibration_of(const Rig& rig) {
  Calibration calibration;
  for (const CameraCalibration& camera : rig.cameras) {
    calibration.T_body_camera.push_back(to_block(camera.T_body_camera));
    calibration.lenses.push_back({});
  }
  calibration.has_dvl = rig.dvl.has_value();
  if (rig.dvl) calibration.T_body_dvl = to_block(rig.dvl->T_body_dvl);
  return calibration;
}

Rig calibrated(Rig rig, const Calibration& calibration) {
  for (std::size_t k = 0; k < rig.cameras.size(); ++k) {
    CameraCalibration& camera = rig.cameras[k];
    const LensBlock& lens = calibration.lenses.at(k);
    CameraModel::Parameters model = camera.model.parameters();
    model.cx += lens[1] * model.fx;
    model.cy += lens[2] * model.fy;
    model.fx *= std::exp(lens[0]);
    model.fy *= std::exp(lens[0]);
    camera.model = CameraModel(model);
    camera.T_body_camera = to_se3(calibration.T_body_camera.at(k).data());
    camera.time_offset_s += calibration.camera_time_offset_s;
  }
  if (!rig.dvl) return rig;
  rig.dvl->T_body_dvl = to_se3(calibration.T_body_dvl.data());
  rig.dvl->scale *= std::exp(calibration.dvl_log_scale);
  return rig;
}

std::vector<CalibrationBlock> blocks(Calibration& calibration, const CalibrationConfig& config) {
  std::vector<CalibrationBlock> found;
  for (PoseBlock& camera : calibration.T_body_camera) {
    found.push_back({{camera.data(), kPoseSize},
                     config.camera_mounting.estimate || config.camera_lever_arm.estimate});
  }
  for (LensBlock& lens : calibration.lenses) {
    found.push_back({{lens.data(), kLensSize},
                     config.focal_length.estimate || config.principal_point.estimate});
  }
  found.push_back({{&calibration.camera_time_offset_s, 1}, config.camera_time_offset.estimate});
  if (!calibration.has_dvl) return found;
  found.push_back({{calibration.T_body_dvl.data(), kPoseSize},
                   config.dvl_mounting.estimate || config.dvl_lever_arm.estimate});
  found.push_back({{&calibration.dvl_log_scale, 1}, config.dvl_scale.estimate});
  return found;
}

Prior calibration_prior(Calibration& calibration, const CalibrationConfig& config) {
  PriorBuilder builder;
  for (const CalibrationBlock& part : blocks(calibration, config)) {
    if (!part.estimate) continue;
    const double* data = part.block.data;
    if (part.block.size == kLensSize) {
      builder.add(part.block, lens_sigmas(config));
    } else if (data == calibration.T_body_dvl.data()) {
      builder.add(part.block, pose_sigmas(config.dvl_mounting, config.dvl_lever_arm));
    } else if (part.block.size == kPoseSize) {
      builder.add(part.block, pose_sigmas(config.camera_mounting, config.camera_lever_arm));
    } else {
      const bool is_scale = data == &calibration.dvl_log_scale;
      builder.add(part.block,
                  scalar(is_scale ? config.dvl_scale.sigma : config.camera_time_offset.sigma));
    }
  }
  return std::move(builder).build();
}

Prior calibration_part(const std::shared_ptr<const Prior>& prior,
                       const std::vector<CalibrationBlock>& calibration) {
  if (!prior) return {};
  std::vector<double*> drop;
  for (const Prior::Kept& kept : prior->kept) drop.push_back(kept.block.data);
  for (const CalibrationBlock& part : calibration) {
    std::erase(drop, part.block.data);
    if (part.estimate && !is_known(*prior, part.block.data)) return {};
  }
  Linearizer linearizer;
  std::vector<Block> all;
  for (const Prior::Kept& kept : prior->kept) all.push_back(kept.block);
  linearizer.add(PriorFactor(prior), nullptr, all);
  return linearizer.marginalize(drop, Linearizer::Method::schur);
}

Prior joined(const Prior& a, const Prior& b) {
  Prior both{.kept = a.kept, .J = {}, .r = Eigen::VectorXd(a.r.size() + b.r.size())};
  both.kept.insert(both.kept.end(), b.kept.begin(), b.kept.end());
  both.J = Eigen::MatrixXd::Zero(a.J.rows() + b.J.rows(), a.J.cols() + b.J.cols());
  both.J.topLeftCorner(a.J.rows(), a.J.cols()) = a.J;
  both.J.bottomRightCorner(b.J.rows(), b.J.cols()) = b.J;
  both.r << a.r, b.r;
  return both;
}

CalibrationMemory::CalibrationMemory(Calibration& calibration, const CalibrationConfig& config)
    : before_{.stamp = {},
              .values = calibration,
              .knowledge = calibration_prior(calibration, config)},
      latest_(before_) {}

void CalibrationMemory::update(Stamp now, const std::shared_ptr<const Prior>& prior,
                               const Calibration& values,
                               const std::vector<CalibrationBlock>& blocks) {
  if (latest_.stamp && now < *latest_.stamp + kMemoryInterval) return;
  Prior knowledge = calibration_part(prior, blocks);
  if (knowledge.kept.empty()) return;
  before_ = std::exchange(latest_, {now, values, std::move(knowledge)});
}

// The blocks keep their addresses.
void CalibrationMemory::restore(Calibration& calibration) {
  latest_ = before_;
  std::ranges::copy(before_.values.T_body_camera, calibration.T_body_camera.begin());
  std::ranges::copy(before_.values.lenses, calibration.lenses.begin());
  calibration.camera_time_offset_s = before_.values.camera_time_offset_s;
  calibration.T_body_dvl = before_.values.T_body_dvl;
  calibration.dvl_log_scale = before_.values.dvl_log_scale;
}

CalibrationEstimate estimate_of(const Calibration& calibration, const Rig& rig,
                                const CalibrationConfig& config, const Prior& knowledge) {
  if (knowledge.kept.empty()) return {};
  ParameterReader reader(knowledge);
  for (std::size_t k = 0; k < rig.cameras.size(); ++k) {
    const std::string camera = "cam" + std::to_string(k);
    const LensBlock& lens = calibration.lenses.at(k);
    reader.add_pose(camera, calibration.T_body_camera.at(k), rig.cameras[k].T_body_camera,
                    config.camera_mounting, config.camera_lever_arm);
    reader.add(camera + ".focal_length", lens.data(), 0, scalar(std::expm1(lens[0])),
               config.focal_length);
    reader.add(camera + ".principal_point", lens.data(), 1, Eigen::Vector2d(lens[1], lens[2]),
               config.principal_point);
  }
  if (!rig.cameras.empty()) {
    reader.add("cam0.time_offset_s", &calibration.camera_time_offset_s, 0,
               scalar(calibration.camera_time_offset_s), config.camera_time_offset);
  }
  if (!rig.dvl) return reader.take();
  reader.add_pose("dvl0", calibration.T_body_dvl, rig.dvl->T_body_dvl, config.dvl_mounting,
                  config.dvl_lever_arm);
  reader.add("dvl0.scale", &calibration.dvl_log_scale, 0,
             scalar(std::expm1(calibration.dvl_log_scale)), config.dvl_scale);
  return reader.take();
}

Calibration with_changes(const Rig& rig, const std::vector<CalibrationParameter>& parameters) {
  Calibration changed = calibration_of(rig);
  for (std::size_t k = 0; k < rig.cameras.size(); ++k) {
    const std::string camera = "cam" + std::to_string(k);
    change_pose(changed.T_body_camera[k], camera, parameters);
    LensBlock& lens = changed.lenses[k];
    if (const auto* c = change_of(parameters, camera + ".focal_length"))
      lens[0] = std::log1p((*c)(0));
    if (const auto* c = change_of(parameters, camera + ".principal_point")) {
      lens[1] = (*c)(0);
      lens[2] = (*c)(1);
    }
  }
  if (const auto* c = change_of(parameters, "cam0.time_offset_s")) {
    changed.camera_time_offset_s = (*c)(0);
  }
  if (!rig.dvl) return changed;
  change_pose(changed.T_body_dvl, "dvl0", parameters);
  if (const auto* c = change_of(parameters, "dvl0.scale"))
    changed.dvl_log_scale = std::log1p((*c)(0));
  return changed;
}

}  // namespace apvi::vio
