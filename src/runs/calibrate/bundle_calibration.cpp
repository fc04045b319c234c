// SPDX-License-Identifier: BSD-3-Clause
#include "runs/calibrate/bundle_calibration.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <array>
#include <string>
#include <vector>

#include "apvi/geometry/so3.hpp"

namespace apvi::runs {
namespace {

struct Part {
  const char* name;
  int first;  ///< component of BundleCamera::covariance
};
constexpr std::array<Part, 4> kParts{{{"cam0.mounting", 0},
                                      {"cam0.lever_arm", 3},
                                      {"cam0.focal_length", 6},
                                      {"cam0.principal_point", 7}}};

using Changes = Eigen::Matrix<double, 9, 1>;

// From the rig's values, in the units of CalibrationParameter.
Changes changes_of(const loop_closure::BundleCamera& camera, const SE3& rig) {
  Changes changes;
  changes << so3::log(rig.rotation.conjugate() * camera.T_body_camera.rotation),
      camera.T_body_camera.translation - rig.translation, camera.lens.scale - 1.0,
      camera.lens.offset;
  return changes;
}

/// Components of an estimate: those of the camera, with the same ones of a BundleCamera, and
/// others.
struct Split {
  std::vector<Eigen::Index> camera, in_bundle, others;
};

Split split(const vio::CalibrationEstimate& estimate) {
  Split found;
  Eigen::Index row = 0;
  for (const vio::CalibrationParameter& p : estimate.parameters) {
    const auto part =
        std::ranges::find_if(kParts, [&](const Part& known) { return p.name == known.name; });
    for (Eigen::Index k = 0; k < p.change.size(); ++k, ++row) {
      if (part == kParts.end()) {
        found.others.push_back(row);
      } else {
        found.camera.push_back(row);
        found.in_bundle.push_back(part->first + k);
      }
    }
  }
  return found;
}

Eigen::VectorXd all_changes(const vio::CalibrationEstimate& estimate) {
  Eigen::VectorXd all(estimate.covariance.rows());
  Eigen::Index row = 0;
  for (const vio::CalibrationParameter& p : estimate.parameters) {
    all.segment(row, p.change.size()) = p.change;
    row += p.change.size();
  }
  return all;
}

void set_changes(const Eigen::VectorXd& all, vio::CalibrationEstimate& estimate) {
  const Eigen::VectorXd sigmas = estimate.covariance.diagonal().cwiseMax(0.0).cwiseSqrt();
  Eigen::Index row = 0;
  for (vio::CalibrationParameter& p : estimate.parameters) {
    const Eigen::Index size = p.change.size();
    p.change = all.segment(row, size);
    p.sigma = sigmas.segment(row, size);
    row += size;
  }
}

}  // namespace

void adopt_camera(const loop_closure::BundleCamera& camera, const Rig& rig,
                  vio::CalibrationEstimate& estimate) {
  const Split rows = split(estimate);
  if (rows.camera.empty()) return;
  const Eigen::MatrixXd before = estimate.covariance;
  const Eigen::MatrixXd of_camera = before(rows.camera, rows.camera);
  const Eigen::MatrixXd across = before(rows.others, rows.camera);
  // Of the others on the camera.
  const Eigen::MatrixXd regression = of_camera.ldlt().solve(across.transpose()).transpose();
  const Changes adjusted = changes_of(camera, rig.cameras.front().T_body_camera);
  Eigen::VectorXd changes = all_changes(estimate);
  const Eigen::VectorXd moved = adjusted(rows.in_bundle) - changes(rows.camera);
  const Eigen::MatrixXd adjusted_covariance = camera.covariance(rows.in_bundle, rows.in_bundle);
  const Eigen::MatrixXd follows = regression * adjusted_covariance;
  changes(rows.camera) += moved;
  changes(rows.others) += regression * moved;
  Eigen::MatrixXd& after = estimate.covariance;
  after(rows.camera, rows.camera) = adjusted_covariance;
  after(rows.others, rows.camera) = follows;
  after(rows.camera, rows.others) = follows.transpose();
  after(rows.others, rows.others) += (follows - across) * regression.transpose();
  set_changes(changes, estimate);
}

}  // namespace apvi::runs
