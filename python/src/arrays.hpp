// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <pybind11/numpy.h>

#include <Eigen/Core>
#include <initializer_list>
#include <opencv2/core/mat.hpp>
#include <vector>

#include "apvi/geometry/se3.hpp"
#include "bindings.hpp"

/// Conversions between numpy arrays and the types of the C++ API. All of them copy.
namespace apvi::python {

/// Accepts whatever numpy can convert.
using Numbers = py::array_t<double, py::array::c_style | py::array::forcecast>;
/// Accepts bytes only: values of other types would lose digits silently.
using Bytes = py::array_t<std::uint8_t, py::array::c_style>;

/// [4,4] homogeneous matrix.
Numbers to_array(const SE3& pose);
/// Throws InputError for anything but a rigid transform. Rotations are re-orthonormalized.
SE3 to_pose(const Numbers& matrix);

/// [3]
Numbers to_array(const Eigen::Vector3d& v);
/// Throws InputError, with the name, unless there are three numbers.
Eigen::Vector3d to_vector(const Numbers& values, const char* name);

/// [h,w] gray or [h,w,3] RGB of OpenCV's 8-bit gray or BGR.
Bytes to_array(const cv::Mat& image);
/// The inverse. Throws InputError for other shapes.
cv::Mat to_image(const Bytes& pixels);

/// An array of this shape with these values.
py::array_t<float> to_array(const std::vector<float>& values,
                            std::initializer_list<std::size_t> shape);
/// The values of an array of any shape, row by row.
std::vector<float> to_floats(
    const py::array_t<float, py::array::c_style | py::array::forcecast>& a);

/// Throws InputError unless the array has this shape; a negative extent stands for any.
void require_shape(const py::array& array, std::initializer_list<py::ssize_t> shape,
                   const char* name);

}  // namespace apvi::python
