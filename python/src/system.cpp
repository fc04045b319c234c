// SPDX-License-Identifier: BSD-3-Clause
#include "apvi/slam/system.hpp"

#include <pybind11/stl.h>

#include "arrays.hpp"
#include "bindings.hpp"
#include "callbacks.hpp"
#include "options.hpp"
#include "rig.hpp"
#include "views.hpp"

namespace apvi::python {
namespace {

using Unlocked = py::call_guard<py::gil_scoped_release>;

py::tuple pose_arguments(const StampedPose& pose) {
  return py::make_tuple(pose.stamp.ns, to_array(pose.T_world_body));
}

py::tuple scale_arguments(const localization::ScaleFound& found) {
  return py::make_tuple(found.since.ns, found.to_meters.scale);
}

/// Its threads may wait for Python's global lock, so it ends without holding it.
class System {
 public:
  System(const Options& options, const RigFile& rig, const py::object& on_pose,
         const py::object& on_scale_found) {
    const slam::SystemCallbacks callbacks{
        .pose = callback<StampedPose>(on_pose, pose_arguments),
        .scale_found = callback<localization::ScaleFound>(on_scale_found, scale_arguments)};
    const py::gil_scoped_release unlocked;
    system_.emplace(runs::slam_options(options.config), rig.rig, callbacks);
  }
  ~System() {
    const py::gil_scoped_release unlocked;
    system_.reset();
  }
  System(const System&) = delete;
  System& operator=(const System&) = delete;

  slam::System& get() { return *system_; }

 private:
  std::optional<slam::System> system_;
};

std::optional<slam::RenderedImages> render(System& system, const CameraModel& camera,
                                           const Numbers& T_world_camera) {
  const slam::RenderView view = to_view(camera, T_world_camera);
  const py::gil_scoped_release unlocked;
  return system.get().render(view);
}

std::optional<py::tuple> newest_pose(System& system) {
  std::optional<StampedPose> pose;
  {
    const py::gil_scoped_release unlocked;
    pose = system.get().pose();
  }
  return pose ? std::optional(pose_arguments(*pose)) : std::nullopt;
}

Numbers map_to_odometry(System& system) {
  SE3 T_map_odom;
  {
    const py::gil_scoped_release unlocked;
    T_map_odom = system.get().T_map_odom();
  }
  return to_array(T_map_odom);
}

void bind_status(py::module_& m) {
  py::class_<slam::Status>(m, "Status")
      .def_readonly("poses", &slam::Status::poses)
      .def_readonly("keyframes", &slam::Status::keyframes)
      .def_readonly("gaussians", &slam::Status::gaussians)
      .def_readonly("mapping_error", &slam::Status::mapping_error,
                    "why mapping is disabled; empty while it works");
}

// Results so far; from any thread.
void bind_results(py::class_<System>& type) {
  type.def(
          "trajectory", [](System& s) { return s.get().trajectory(); }, Unlocked())
      .def("pose", &newest_pose, "The newest (stamp, T_world_body [4,4]), or None.")
      .def("T_map_odom", &map_to_odometry,
           "[4,4]; from the left, it takes the drift found so far out of the newest pose.")
      .def(
          "status", [](System& s) { return s.get().status(); }, Unlocked())
      .def(
          "map", [](System& s) { return s.get().map(); }, Unlocked(),
          "A copy of the map, or None before the first keyframe.")
      .def("render", &render, py::arg("camera"), py::arg("T_world_camera"),
           "Renders from a pose [4,4] of a camera without distortion, or None.");
}

}  // namespace

void bind_system(py::module_& m) {
  bind_status(m);
  py::class_<System> type(m, "System", "Localization and mapping: samples in, poses and maps out.");
  type.def(py::init<const Options&, const RigFile&, const py::object&, const py::object&>(),
           py::arg("options"), py::arg("rig"), py::kw_only(), py::arg("on_pose") = py::none(),
           py::arg("on_scale_found") = py::none(),
           "on_pose(stamp, T_world_body) and on_scale_found(since, scale) may be called from\n"
           "threads of the library. Raises InputError for a rig without what the options need.")
      .def(
          "process", [](System& s, const SensorEvent& e) { s.get().process(e); }, py::arg("sample"),
          Unlocked(), "Takes a sample; all sensors in order of time.")
      .def(
          "finish", [](System& s) { s.get().finish(); }, Unlocked(),
          "Completes everything taken in.")
      .def(
          "refine", [](System& s) { s.get().refine(); }, Unlocked(),
          "Optimizes the finished map further: mapping.final_iterations steps.")
      .def(
          "stop", [](System& s) { s.get().stop(); }, Unlocked(),
          "Abandons what the threads have not begun.");
  bind_results(type);
}

}  // namespace apvi::python
