// SPDX-License-Identifier: BSD-3-Clause
#include "runs/calibrate/bundle_calibration.hpp"

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

}  // namespace

void adopt_camera(const loop_closure::BundleCamera& camera, const Rig& rig,
                  vio::CalibrationEstimate& estimate) {
  const Changes changes = changes_of(camera, rig.cameras.front().T_body_camera);
  std::vector<Eigen::Index> rows, in_bundle;  // of the camera, in both covariances
  Eigen::Index row = 0;
  for (vio::CalibrationParameter& p : estimate.parameters) {
    const Eigen::Index size = p.change.size();
    const auto part =
        std::ranges::find_if(kParts, [&](const Part& known) { return p.name == known.name; });
    for (Eigen::Index k = 0; part != kParts.end() && k < size; ++k) {
      rows.push_back(row + k);
      in_bundle.push_back(part->first + k);
    }
    if (part != kParts.end()) {
      p.change = changes.segment(part->first, size);
      p.sigma = camera.covariance.diagonal().segment(part->first, size).cwiseSqrt();
    }
    row += size;
  }
  estimate.covariance(rows, Eigen::all).setZero();
  estimate.covariance(Eigen::all, rows).setZero();
  estimate.covariance(rows, rows) = camera.covariance(in_bundle, in_bundle);
}

}  // namespace apvi::runs
