// SPDX-License-Identifier: BSD-3-Clause
#include "apvi/sensors/central_fit.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <functional>
#include <string>

#include "apvi/config/node.hpp"
#include "apvi/core/error.hpp"
#include "port_cameras.hpp"
#include "sensors/central_rig.hpp"
#include "support/matchers.hpp"

namespace apvi {
namespace {

using Eigen::Vector3d;
using test::dome_port;
using test::flat_port;
using test::lens_in_air;
using test::MatrixNear;
using testing::HasSubstr;

std::string input_error(const std::function<void()>& f) {
  try {
    f();
  } catch (const InputError& e) {
    return e.what();
  }
  return "";
}

// The paraxial limit of a flat port: the focal length grows by the index of water, and rays seem to
// meet where a plate moves the lens center to.
TEST(CentralCamera, OfANarrowLensIsTheParaxialOne) {
  CameraModel::Parameters narrow = lens_in_air().parameters();
  narrow.fx = narrow.fy = 6000.0;
  narrow.coefficients = {};
  const Port port = flat_port();
  const CentralCamera central =
      fit_central_camera(PortCamera(CameraModel(narrow), port), 2.0, Distortion::radtan);
  EXPECT_NEAR(central.model.parameters().fx, 6000.0 * port.water_index, 2.0);
  const double apparent = port.distance_m * port.water_index / port.air_index +
                          port.glass_thickness_m * port.water_index / port.glass_index;
  const double behind = port.distance_m + port.glass_thickness_m - apparent;
  EXPECT_THAT(central.center, MatrixNear(Vector3d(0, 0, behind), 3e-4));
}

TEST(CentralCamera, WithoutRefractionIsTheLens) {
  Port port = flat_port();
  port.glass_index = port.water_index = 1.0;
  const PortCamera camera(lens_in_air(), port);
  const CentralCamera central = fit_central_camera(camera, 2.0);
  EXPECT_THAT(central.center, MatrixNear(Vector3d(0, 0, 0), 1e-9));
  EXPECT_LT(central_error(camera, central, 0.5).max_px, 1e-4);
}

TEST(CentralCamera, HasItsLeastErrorAtTheWorkingRange) {
  for (const Port& port : {flat_port(), flat_port(0.05, 0.01), dome_port({0.0, 0.0, 0.01})}) {
    const PortCamera camera(lens_in_air(), port);
    const CentralCamera central = fit_central_camera(camera, 2.0);
    const double at_working_range = central_error(camera, central, 2.0).rms_px;
    EXPECT_LT(at_working_range, 0.3);
    EXPECT_LT(at_working_range, central_error(camera, central, 0.4).rms_px);
    EXPECT_LE(at_working_range, central_error(camera, central, 20.0).rms_px);
    EXPECT_LT(central_error(camera, central, 1.0).rms_px, 2.0);
  }
}

TEST(CentralCamera, ATiltedPortIsFittedTheLessCloselyTheMoreItLeans) {
  double before = 0.0;
  for (const double tilt_rad : {0.0, 0.008, 0.016, 0.032, 0.064}) {
    const PortCamera camera(lens_in_air(), flat_port(0.05, tilt_rad));
    const double error = central_error(camera, fit_central_camera(camera, 2.0), 2.0).rms_px;
    EXPECT_GT(error, before);
    EXPECT_LT(error, 0.05 + 25.0 * tilt_rad);
    before = error;
  }
}

// A central camera at the lens center is right at one range only.
TEST(CentralCamera, ItsCenterKeepsTheErrorSmallAtOtherRanges) {
  const PortCamera camera(lens_in_air(), flat_port());
  const CentralCamera central = fit_central_camera(camera, 2.0);
  CentralCamera at_lens = central;
  at_lens.center = Vector3d::Zero();
  EXPECT_LT(central_error(camera, central, 0.5).rms_px,
            0.2 * central_error(camera, at_lens, 0.5).rms_px);
}

// Independent of the fit: a point seen through the port, seen by the central model.
TEST(CentralCamera, SeesWhatThePortShows) {
  const PortCamera camera(lens_in_air(), flat_port());
  for (const Distortion lens : {Distortion::radtan, Distortion::equidistant}) {
    const CentralCamera central = fit_central_camera(camera, 2.0, lens);
    EXPECT_EQ(central.model.parameters().distortion, lens);
    const double tolerance = central_error(camera, central, 2.0).max_px + 0.02;
    for (const double x : {-1.0, -0.4, 0.0, 0.7}) {
      const Vector3d point = 2.0 * Vector3d(x, 0.5 * x + 0.1, 1.5).normalized() + central.center;
      EXPECT_LT((*camera.project(point) - *central.model.project(point - central.center)).norm(),
                tolerance);
    }
  }
}

constexpr const char* kRig =
    "cam0:\n  intrinsics: [300, 301, 318, 241]\n  resolution: [640, 480]\n"
    "  T_body_sensor: [0,0,1,0.2, -1,0,0,0, 0,-1,0,0, 0,0,0,1]\n"
    "  port: {distance_m: 0.05, tilt_deg: [1, 0], working_range_m: 3}\n";

TEST(RigWithPort, UsesTheNearestCentralCamera) {
  const Rig rig = make_rig(config::parse_yaml(kRig, "rig.yaml"));
  const CameraCalibration& camera = rig.cameras.at(0);
  ASSERT_TRUE(camera.port);
  EXPECT_EQ(camera.port->working_range_m, 3.0);
  EXPECT_EQ(camera.lens().parameters().fx, 300.0);
  EXPECT_NEAR(camera.model.parameters().fx, 1.333 * 300.0, 20.0);
  EXPECT_THAT(camera.T_body_lens().translation, MatrixNear(Vector3d(0.2, 0, 0), 1e-12));
  // The camera looks along x of the body; its rays meet behind the lens.
  EXPECT_LT(camera.T_body_camera.translation.x(), 0.19);
  EXPECT_THAT(port_summary(camera), HasSubstr("behind a flat port; used as the nearest central"));
}

TEST(RigWithPort, IsWrittenWithItsCentralCamera) {
  const config::Node node = config::parse_yaml(kRig, "rig.yaml");
  const Rig rig = make_rig(node);
  const std::string yaml = config::to_yaml(central_rig(node, rig));
  EXPECT_THAT(yaml, testing::Not(HasSubstr("port")));
  const Rig again = make_rig(config::parse_yaml(yaml, "central.yaml"));
  EXPECT_FALSE(again.cameras.at(0).port);
  EXPECT_THAT(again.cameras[0].T_body_camera, test::PoseNear(rig.cameras[0].T_body_camera, 1e-8));
  const Vector3d point(0.5, -0.3, 2.0);
  EXPECT_THAT(*again.cameras[0].model.project(point),
              MatrixNear(*rig.cameras[0].model.project(point), 1e-4));
}

TEST(RigWithPort, ErrorsSayWhatIsMissing) {
  const auto error = [](const std::string& port) {
    return input_error([&] {
      make_rig(config::parse_yaml(
          "cam0:\n  intrinsics: [300, 301, 318, 241]\n  resolution: [640, 480]\n  port: " + port,
          "rig.yaml"));
    });
  };
  EXPECT_THAT(error("{}"), HasSubstr("rig.yaml:4: cam0.port.distance_m: missing"));
  EXPECT_THAT(error("{kind: dome}"), HasSubstr("cam0.port.radius_m: missing"));
  EXPECT_THAT(error("{kind: dome, radius_m: 0.05, center_m: [0, 0, 0.06]}"),
              HasSubstr("rig.yaml:4: cam0.port: the lens center is outside the dome"));
  EXPECT_THAT(error("{distance_m: -1}"), HasSubstr("cam0.port.distance_m: -1 is outside"));
}

}  // namespace
}  // namespace apvi
