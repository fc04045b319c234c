// SPDX-License-Identifier: BSD-3-Clause
#include "apvi/geometry/trajectory.hpp"

#include <pybind11/stl.h>
#include <pybind11/stl/filesystem.h>

#include <algorithm>

#include "apvi/core/error.hpp"
#include "apvi/io/tum.hpp"
#include "arrays.hpp"
#include "bindings.hpp"

namespace apvi::python {
namespace {

using Stamps = py::array_t<std::int64_t, py::array::c_style | py::array::forcecast>;

py::ssize_t length(const Trajectory& t) {
  return static_cast<py::ssize_t>(t.size());
}

Stamps stamps(const Trajectory& t) {
  Stamps out(length(t));
  std::transform(t.poses.begin(), t.poses.end(), out.mutable_data(),
                 [](const StampedPose& pose) { return pose.stamp.ns; });
  return out;
}

Numbers positions(const Trajectory& t) {
  Numbers out({length(t), py::ssize_t{3}});
  double* x = out.mutable_data();
  for (const StampedPose& p : t.poses) x = std::copy_n(p.T_world_body.translation.data(), 3, x);
  return out;
}

// Eigen stores x y z w.
Numbers quaternions(const Trajectory& t) {
  Numbers out({length(t), py::ssize_t{4}});
  double* x = out.mutable_data();
  for (const StampedPose& p : t.poses) {
    x = std::copy_n(p.T_world_body.rotation.coeffs().data(), 4, x);
  }
  return out;
}

Numbers matrices(const Trajectory& t) {
  Numbers out({length(t), py::ssize_t{4}, py::ssize_t{4}});
  double* x = out.mutable_data();
  for (const StampedPose& p : t.poses) {
    const Eigen::Matrix<double, 4, 4, Eigen::RowMajor> m = p.T_world_body.matrix();
    x = std::copy_n(m.data(), 16, x);
  }
  return out;
}

// Rows as in a TUM file: t [s] tx ty tz qx qy qz qw.
Numbers tum(const Trajectory& t) {
  Numbers out({length(t), py::ssize_t{8}});
  double* x = out.mutable_data();
  for (const StampedPose& p : t.poses) {
    *x++ = p.stamp.seconds();
    x = std::copy_n(p.T_world_body.translation.data(), 3, x);
    x = std::copy_n(p.T_world_body.rotation.coeffs().data(), 4, x);
  }
  return out;
}

StampedPose make_pose(std::int64_t ns, const double* p, const double* q) {
  const Eigen::Quaterniond rotation =
      q != nullptr ? Eigen::Quaterniond(q) : Eigen::Quaterniond::Identity();
  if (!(std::abs(rotation.norm() - 1.0) < 0.01)) {
    fail_input("trajectory: the quaternion at {} ns is not of unit norm", ns);
  }
  return {Stamp{ns}, {q != nullptr ? rotation.normalized() : rotation, {p[0], p[1], p[2]}}};
}

Trajectory make_trajectory(const Stamps& ns, const Numbers& p, const std::optional<Numbers>& q) {
  require_shape(ns, {-1}, "stamps");
  require_shape(p, {ns.size(), 3}, "positions");
  if (q) require_shape(*q, {ns.size(), 4}, "quaternions");
  Trajectory out;
  out.has_rotation = q.has_value();
  for (py::ssize_t i = 0; i < ns.size(); ++i) {
    const double* rotation = q ? q->data() + 4 * i : nullptr;
    if (i > 0 && ns.data()[i] <= ns.data()[i - 1]) {
      fail_input("trajectory: stamps must increase, but do not at index {}", i);
    }
    out.poses.push_back(make_pose(ns.data()[i], p.data() + 3 * i, rotation));
  }
  return out;
}

std::optional<Numbers> pose_at(const Trajectory& t, std::int64_t ns, double max_gap_s) {
  const auto pose = t.at(Stamp{ns}, Duration::from_seconds(max_gap_s));
  return pose ? std::optional(to_array(*pose)) : std::nullopt;
}

Trajectory read(const std::filesystem::path& path) {
  const py::gil_scoped_release release;
  return io::read_trajectory(path);
}

}  // namespace

void bind_trajectory(py::module_& m) {
  py::class_<Trajectory>(m, "Trajectory", "Poses T_world_body in order of time.")
      .def(py::init(&make_trajectory), py::arg("stamps"), py::arg("positions"),
           py::arg("quaternions") = py::none(),
           "stamps [n] ns, positions [n,3] m, quaternions [n,4] x y z w; None: positions only.")
      .def_static("read", &read, py::arg("path"), "Reads a TUM or EuRoC file. Raises InputError.")
      .def("__len__", &Trajectory::size)
      .def_property_readonly("stamps", &stamps, "[n] int64, nanoseconds")
      .def_property_readonly("positions", &positions, "[n,3] m")
      .def_property_readonly("quaternions", &quaternions, "[n,4] x y z w")
      .def_property_readonly("matrices", &matrices, "[n,4,4]")
      .def_property_readonly("tum", &tum, "[n,8] t [s] tx ty tz qx qy qz qw")
      .def_readonly("has_rotation", &Trajectory::has_rotation)
      .def_property_readonly("path_length_m", &Trajectory::path_length)
      .def("at", &pose_at, py::arg("stamp"), py::arg("max_gap_s") = 0.5,
           "Interpolated pose [4,4], or None outside the span and in longer gaps.")
      .def(
          "write_tum",
          [](const Trajectory& t, const std::filesystem::path& path) { io::write_tum(path, t); },
          py::arg("path"))
      .def(
          "write_euroc",
          [](const Trajectory& t, const std::filesystem::path& path) { io::write_euroc(path, t); },
          py::arg("path"));
}

}  // namespace apvi::python
