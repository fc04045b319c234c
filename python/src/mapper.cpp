// SPDX-License-Identifier: BSD-3-Clause
#include "apvi/slam/mapper.hpp"

#include <pybind11/stl.h>

#include "arrays.hpp"
#include "bindings.hpp"
#include "options.hpp"
#include "rig.hpp"
#include "views.hpp"

namespace apvi::python {
namespace {

using Unlocked = py::call_guard<py::gil_scoped_release>;
using slam::Mapper;

std::unique_ptr<Mapper> make_mapper(const Options& options, const RigFile& rig) {
  const py::gil_scoped_release unlocked;
  return std::make_unique<Mapper>(runs::slam_options(options.config), rig.rig);
}

void add(Mapper& mapper, const ImageFrame& frame, const Numbers& T_world_body) {
  const SE3 pose = to_pose(T_world_body);
  const py::gil_scoped_release unlocked;
  mapper.add(frame, pose);
}

std::optional<slam::RenderedImages> render(const Mapper& mapper, const CameraModel& camera,
                                           const Numbers& T_world_camera) {
  const slam::RenderView view = to_view(camera, T_world_camera);
  const py::gil_scoped_release unlocked;
  return mapper.render(view);
}

}  // namespace

void bind_mapper(py::module_& m) {
  py::class_<Mapper>(m, "Mapper", "Mapping alone: images with known poses in, a map out.")
      .def(py::init(&make_mapper), py::arg("options"), py::arg("rig"))
      .def("add", &add, py::arg("frame"), py::arg("T_world_body"),
           "Takes an image of the first camera with the pose [4,4] of the body, in order of time.")
      .def("finish", &Mapper::finish, Unlocked(), "Completes everything taken in.")
      .def("refine", &Mapper::refine, Unlocked(),
           "Optimizes the finished map further: mapping.final_iterations steps.")
      .def("stop", &Mapper::stop, Unlocked(), "Abandons what the threads have not begun.")
      .def("map", &Mapper::map, Unlocked(), "A copy of the map, or None before the first images.")
      .def("render", &render, py::arg("camera"), py::arg("T_world_camera"),
           "Renders from a pose [4,4] of a camera without distortion, or None.");
}

}  // namespace apvi::python
