// SPDX-License-Identifier: BSD-3-Clause
#include "rig.hpp"

#include <pybind11/stl.h>

#include "apvi/core/error.hpp"
#include "apvi/io/rig_file.hpp"
#include "apvi/sensors/lens.hpp"
#include "arrays.hpp"
#include "bindings.hpp"
#include "nodes.hpp"

namespace apvi::python {
namespace {

using Parameters = CameraModel::Parameters;

Distortion distortion_named(const std::string& name) {
  for (const Distortion d : {Distortion::none, Distortion::radtan, Distortion::equidistant,
                             Distortion::double_sphere, Distortion::eucm}) {
    if (lens_name(d) == name) return d;
  }
  fail_input("camera: distortion {}: not none, radtan, equidistant, double_sphere or eucm", name);
}

CameraModel make_camera(double fx, double fy, double cx, double cy, int width, int height,
                        const std::string& distortion, const std::vector<double>& coefficients) {
  Parameters p{.fx = fx, .fy = fy, .cx = cx, .cy = cy, .width = width, .height = height};
  if (!(fx > 0.0) || !(fy > 0.0) || width <= 0 || height <= 0) {
    fail_input("camera: focal lengths and size must be positive");
  }
  try {
    set_lens(distortion_named(distortion), coefficients, p);
  } catch (const std::invalid_argument& error) {
    fail_input("camera: {}", error.what());
  }
  if (const auto problem = lens_problem(p)) fail_input("camera: {}", *problem);
  return CameraModel(p);
}

CameraModel pinhole(const CameraModel& camera) {
  Parameters p = camera.parameters();
  p.distortion = Distortion::none;
  p.coefficients = {};
  return CameraModel(p);
}

// NaN where the lens does not see.
Numbers project(const CameraModel& camera, const Numbers& points) {
  require_shape(points, {-1, 3}, "points");
  Numbers out({points.shape(0), py::ssize_t{2}});
  const Eigen::Vector2d nowhere = Eigen::Vector2d::Constant(std::nan(""));
  for (py::ssize_t i = 0; i < points.shape(0); ++i) {
    const Eigen::Vector3d p(points.data() + 3 * i);
    const Eigen::Vector2d pixel = camera.project(p).value_or(nowhere);
    std::copy_n(pixel.data(), 2, out.mutable_data() + 2 * i);
  }
  return out;
}

Numbers unproject(const CameraModel& camera, const Numbers& pixels) {
  require_shape(pixels, {-1, 2}, "pixels");
  Numbers out({pixels.shape(0), py::ssize_t{3}});
  const Eigen::Vector3d nowhere = Eigen::Vector3d::Constant(std::nan(""));
  for (py::ssize_t i = 0; i < pixels.shape(0); ++i) {
    const Eigen::Vector2d p(pixels.data() + 2 * i);
    const Eigen::Vector3d ray = camera.unproject(p).value_or(nowhere);
    std::copy_n(ray.data(), 3, out.mutable_data() + 3 * i);
  }
  return out;
}

RigFile make_rig_file(const py::object& source) {
  if (py::isinstance<py::dict>(source)) return RigFile(to_node(source, "rig"));
  if (!is_path(source)) fail_input("rig: expected the path of a file, or a dict");
  return RigFile(io::load_rig_file(to_path(source), {configurations()}));
}

std::vector<std::string> sensors_of(const RigFile& file) {
  std::vector<std::string> names;
  const Rig& rig = file.rig;
  if (!rig.cameras.empty()) names.emplace_back("camera");
  if (rig.imu) names.emplace_back("imu");
  if (rig.dvl) names.emplace_back("dvl");
  if (rig.pressure || rig.depth) names.emplace_back("pressure");
  return names;
}

void bind_camera(py::module_& m) {
  const auto of = [](double Parameters::*member) {
    return [member](const CameraModel& c) { return c.parameters().*member; };
  };
  py::class_<CameraModel>(m, "Camera",
                          "A central camera. The center of the top-left pixel is (0, 0).")
      .def(py::init(&make_camera), py::arg("fx"), py::arg("fy"), py::arg("cx"), py::arg("cy"),
           py::arg("width"), py::arg("height"), py::arg("distortion") = "none",
           py::arg("coefficients") = std::vector<double>())
      .def_property_readonly("fx", of(&Parameters::fx), "pixels")
      .def_property_readonly("fy", of(&Parameters::fy), "pixels")
      .def_property_readonly("cx", of(&Parameters::cx), "pixels")
      .def_property_readonly("cy", of(&Parameters::cy), "pixels")
      .def_property_readonly("width", [](const CameraModel& c) { return c.parameters().width; })
      .def_property_readonly("height", [](const CameraModel& c) { return c.parameters().height; })
      .def_property_readonly(
          "distortion", [](const CameraModel& c) { return lens_name(c.parameters().distortion); })
      .def_property_readonly("coefficients",
                             [](const CameraModel& c) { return coefficients_of(c.parameters()); })
      .def("pinhole", &pinhole, "The same camera without distortion, as maps are rendered.")
      .def("project", &project, py::arg("points"),
           "Pixels [n,2] of points [n,3] in the camera frame [m]; NaN where the lens does not see.")
      .def("unproject", &unproject, py::arg("pixels"), "Unit rays [n,3] of pixels [n,2].");
}

}  // namespace

void bind_rig(py::module_& m) {
  bind_camera(m);
  py::class_<CameraCalibration>(m, "CameraCalibration")
      .def_readonly("camera", &CameraCalibration::model)
      .def_property_readonly("T_body_camera",
                             [](const CameraCalibration& c) { return to_array(c.T_body_camera); })
      .def_readonly("rate_hz", &CameraCalibration::rate_hz)
      .def_readonly("time_offset_s", &CameraCalibration::time_offset_s);
  py::class_<RigFile>(m, "Rig", "Calibration of a vehicle. The body frame is the IMU's.")
      .def(py::init(&make_rig_file), py::arg("source"),
           "From rig.yaml, a file of another tool, or a dict with the keys of rig.yaml.")
      .def_property_readonly(
          "world", [](const RigFile& r) { return r.rig.world == WorldFrame::ned ? "ned" : "up"; },
          "up: z up; ned: x north, y east, z down")
      .def_property_readonly("sensors", &sensors_of, "of camera, imu, dvl and pressure")
      .def_property_readonly("cameras", [](const RigFile& r) { return r.rig.cameras; })
      .def_property_readonly("T_body_dvl",
                             [](const RigFile& r) -> std::optional<Numbers> {
                               if (!r.rig.dvl) return std::nullopt;
                               return to_array(r.rig.dvl->T_body_dvl);
                             })
      .def("to_dict", [](const RigFile& r) { return to_object(r.node); });
}

}  // namespace apvi::python
