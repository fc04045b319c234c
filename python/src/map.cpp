// SPDX-License-Identifier: BSD-3-Clause
#include <pybind11/stl.h>
#include <pybind11/stl/filesystem.h>

#include "apvi/core/error.hpp"
#include "apvi/slam/map_snapshot.hpp"
#include "arrays.hpp"
#include "bindings.hpp"
#include "map_files.hpp"
#include "views.hpp"

namespace apvi::python {
namespace {

using slam::MapSnapshot;
using slam::MediumCoefficients;
using slam::RenderedImages;

auto row(std::array<double, 3> MediumCoefficients::*member) {
  return [member](const MediumCoefficients& m) {
    return to_array(Eigen::Vector3d((m.*member).data()));
  };
}

auto plane(std::vector<float> RenderedImages::*member) {
  return [member](const RenderedImages& r) {
    return to_array(r.*member,
                    {static_cast<std::size_t>(r.height), static_cast<std::size_t>(r.width)});
  };
}

auto colors(std::vector<float> RenderedImages::*member) {
  return [member](const RenderedImages& r) {
    return to_array(r.*member,
                    {static_cast<std::size_t>(r.height), static_cast<std::size_t>(r.width), 3});
  };
}

auto columns(std::vector<float> MapSnapshot::*member, std::size_t count) {
  return [member, count](const MapSnapshot& s) { return to_array(s.*member, {s.count, count}); };
}

py::array_t<float> opacities(const MapSnapshot& s) {
  return to_array(s.logit_opacities, {s.count});
}

py::array_t<float> harmonics(const MapSnapshot& s) {
  return to_array(s.spherical_harmonics, {s.count, s.sh_coefficients, 3});
}

py::array_t<float> colors_of(const MapSnapshot& s) {
  return to_array(image_colors(s), {s.count, 3});
}

Numbers origin(const MapSnapshot& s) {
  return to_array(Eigen::Vector3d(s.origin.data()));
}

RenderedImages render_map(const MapSnapshot& map, const CameraModel& camera,
                          const Numbers& T_world_camera) {
  const slam::RenderView view = to_view(camera, T_world_camera);
  const py::gil_scoped_release release;
  return slam::render(map, view);
}

void bind_medium(py::module_& m) {
  py::class_<MediumCoefficients>(m, "Medium", "The water, per color channel (RGB).")
      .def_property_readonly("beta_d", row(&MediumCoefficients::beta_d), "[3] attenuation, 1/m")
      .def_property_readonly("beta_b", row(&MediumCoefficients::beta_b), "[3] backscatter, 1/m")
      .def_property_readonly("b_inf", row(&MediumCoefficients::b_inf), "[3] veiling light");
}

void bind_images(py::module_& m) {
  py::class_<RenderedImages>(m, "RenderedImages", "float32 arrays, row by row, in image values.")
      .def_property_readonly("color", colors(&RenderedImages::color), "[h,w,3] with the medium")
      .def_property_readonly("restored", colors(&RenderedImages::restored), "[h,w,3] without it")
      .def_property_readonly("depth", plane(&RenderedImages::depth),
                             "[h,w] along the optical axis, m; 0 where empty")
      .def_property_readonly("alpha", plane(&RenderedImages::alpha), "[h,w] opacity");
}

}  // namespace

slam::RenderView to_view(const CameraModel& camera, const Numbers& T_world_camera) {
  if (camera.parameters().distortion != Distortion::none) {
    fail_input("render: the camera has distortion; use its pinhole()");
  }
  return {camera.parameters(), to_pose(T_world_camera)};
}

void bind_map(py::module_& m) {
  bind_medium(m);
  bind_images(m);
  py::class_<MapSnapshot>(m, "MapSnapshot", "A copy of the map: n Gaussians, float32 arrays.")
      .def_static("read", &read_map, py::arg("path"), py::call_guard<py::gil_scoped_release>(),
                  "From a run folder or a map file (.ply, .spz). Raises InputError.")
      .def("__len__", [](const MapSnapshot& s) { return s.count; })
      .def_readonly("iteration", &MapSnapshot::iteration, "optimization steps so far")
      .def_property_readonly("means", columns(&MapSnapshot::means, 3), "[n,3] m")
      .def_property_readonly("log_scales", columns(&MapSnapshot::log_scales, 3),
                             "[n,3] natural logarithm of the standard deviations in m")
      .def_property_readonly("quaternions", columns(&MapSnapshot::quaternions, 4),
                             "[n,4] w x y z, not normalized")
      .def_property_readonly("logit_opacities", &opacities, "[n]")
      .def_property_readonly("spherical_harmonics", &harmonics,
                             "[n,k,3] RGB in linear light, degree 0 first")
      .def_property_readonly("colors", &colors_of,
                             "[n,3] RGB in image values, of the mean over all directions")
      .def_property_readonly("origin", &origin, "[3] to be added to means, m; zero unless read")
      .def_readonly("medium", &MapSnapshot::medium, "Medium, or None")
      .def_readonly("keyframes", &MapSnapshot::keyframes, "poses of the body")
      .def("render", &render_map, py::arg("camera"), py::arg("T_world_camera"),
           "Renders from a pose [4,4] of a camera without distortion.")
      .def("save", &save_map, py::arg("path"), py::call_guard<py::gil_scoped_release>(),
           "Writes .ply, .compressed.ply or .spz. Raises RunError when it cannot be written.");
}

}  // namespace apvi::python
