// SPDX-License-Identifier: BSD-3-Clause
#include "apvi/sensors/samples.hpp"

#include <pybind11/stl.h>

#include "apvi/core/error.hpp"
#include "arrays.hpp"
#include "bindings.hpp"

namespace apvi::python {
namespace {

using Beams = std::vector<std::optional<DvlBeam>>;

// As attributes: nanoseconds.
template <typename Sample>
py::class_<Sample> bind_sample(py::module_& m, const char* name, const char* doc) {
  return py::class_<Sample>(m, name, doc)
      .def_property_readonly(
          "stamp", [](const Sample& s) { return s.stamp.ns; }, "nanoseconds");
}

ImuSample make_imu(std::int64_t stamp, const Numbers& gyro, const Numbers& accel) {
  return {Stamp{stamp}, to_vector(gyro, "gyro"), to_vector(accel, "accel")};
}

DvlSample make_dvl(std::int64_t stamp, const Numbers& velocity, bool valid,
                   std::optional<double> figure_of_merit, std::optional<double> altitude,
                   const Beams& beams) {
  if (beams.size() > kDvlBeams) fail_input("beams: {} instead of {}", beams.size(), kDvlBeams);
  DvlSample sample;
  sample.stamp = Stamp{stamp};
  sample.velocity = to_vector(velocity, "velocity");
  sample.valid = valid;
  sample.figure_of_merit = figure_of_merit;
  sample.altitude = altitude;
  std::copy(beams.begin(), beams.end(), sample.beams.begin());
  return sample;
}

ImageFrame make_frame(std::int64_t stamp, const Bytes& image, int camera) {
  if (camera < 0 || camera > 1) fail_input("camera: {} is not 0 or 1", camera);
  return {Stamp{stamp}, camera, [pixels = to_image(image)] { return pixels; }};
}

Bytes decode(const ImageFrame& frame) {
  cv::Mat image;
  {
    const py::gil_scoped_release release;
    image = frame.decode();
  }
  if (image.empty()) fail_run("image {}: cannot be decoded", frame.stamp.ns);
  return to_array(image);
}

void bind_dvl(py::module_& m) {
  py::class_<DvlBeam>(m, "DvlBeam")
      .def(py::init([](double velocity, std::optional<double> range, bool valid) {
             return DvlBeam{velocity, range, valid};
           }),
           py::arg("velocity"), py::arg("range") = py::none(), py::arg("valid") = true)
      .def_readonly("velocity", &DvlBeam::velocity, "along the beam [m/s]")
      .def_readonly("range", &DvlBeam::range, "m, or None")
      .def_readonly("valid", &DvlBeam::valid);
  bind_sample<DvlSample>(m, "DvlSample", "Velocity over ground in the DVL's frame.")
      .def(py::init(&make_dvl), py::arg("stamp"), py::arg("velocity"), py::arg("valid") = true,
           py::arg("figure_of_merit") = py::none(), py::arg("altitude") = py::none(),
           py::arg("beams") = Beams())
      .def_property_readonly(
          "velocity", [](const DvlSample& s) { return to_array(s.velocity); }, "[3] m/s")
      .def_readonly("valid", &DvlSample::valid, "bottom lock")
      .def_readonly("figure_of_merit", &DvlSample::figure_of_merit, "m/s, or None")
      .def_readonly("altitude", &DvlSample::altitude, "m, or None")
      .def_property_readonly(
          "beams", [](const DvlSample& s) { return Beams(s.beams.begin(), s.beams.end()); });
}

void bind_depth(py::module_& m) {
  bind_sample<PressureSample>(m, "PressureSample", "Absolute pressure.")
      .def(py::init([](std::int64_t stamp, double pa) {
             return PressureSample{Stamp{stamp}, pa};
           }),
           py::arg("stamp"), py::arg("pressure_pa"))
      .def_readonly("pressure_pa", &PressureSample::pressure_pa);
  bind_sample<PressureDepthSample>(m, "PressureDepthSample", "Depth below the surface, positive.")
      .def(py::init([](std::int64_t stamp, double depth) {
             return PressureDepthSample{Stamp{stamp}, depth};
           }),
           py::arg("stamp"), py::arg("depth_m"))
      .def_readonly("depth_m", &PressureDepthSample::depth_m);
  bind_sample<GnssSample>(m, "GnssSample", "Position; for evaluation only.")
      .def(py::init([](std::int64_t stamp, const Numbers& enu) {
             return GnssSample{Stamp{stamp}, to_vector(enu, "east_north_up")};
           }),
           py::arg("stamp"), py::arg("east_north_up"))
      .def_property_readonly(
          "east_north_up", [](const GnssSample& s) { return to_array(s.east_north_up); }, "[3] m");
}

}  // namespace

void bind_samples(py::module_& m) {
  bind_sample<ImuSample>(m, "ImuSample", "Inertial data in the IMU's frame.")
      .def(py::init(&make_imu), py::arg("stamp"), py::arg("gyro"), py::arg("accel"))
      .def_property_readonly(
          "gyro", [](const ImuSample& s) { return to_array(s.gyro); },
          "[3] angular velocity, rad/s")
      .def_property_readonly(
          "accel", [](const ImuSample& s) { return to_array(s.accel); },
          "[3] specific force, m/s²");
  bind_dvl(m);
  bind_depth(m);
  bind_sample<ImageFrame>(m, "ImageFrame", "An image, decoded when its pixels are needed.")
      .def(py::init(&make_frame), py::arg("stamp"), py::arg("image"), py::arg("camera") = 0,
           "image: uint8 [h,w] gray or [h,w,3] RGB, which is copied.")
      .def_property_readonly("image", &decode, "uint8 [h,w] or [h,w,3] RGB. Raises RunError.")
      .def_readonly("camera", &ImageFrame::camera);
}

}  // namespace apvi::python
