// SPDX-License-Identifier: BSD-3-Clause
#include "arrays.hpp"

#include <algorithm>
#include <opencv2/imgproc.hpp>

#include "apvi/core/error.hpp"
#include "apvi/geometry/so3.hpp"

namespace apvi::python {

Numbers to_array(const SE3& pose) {
  Numbers out({4, 4});
  const Eigen::Matrix<double, 4, 4, Eigen::RowMajor> m = pose.matrix();
  std::copy_n(m.data(), 16, out.mutable_data());
  return out;
}

SE3 to_pose(const Numbers& matrix) {
  require_shape(matrix, {4, 4}, "pose");
  const Eigen::Matrix4d m =
      Eigen::Map<const Eigen::Matrix<double, 4, 4, Eigen::RowMajor>>(matrix.data());
  const auto rotation = so3::nearest_rotation(m.topLeftCorner<3, 3>());
  const Eigen::RowVector4d last(0.0, 0.0, 0.0, 1.0);
  if (!m.allFinite() || !rotation || !m.row(3).isApprox(last)) {
    fail_input("pose: not the 4 x 4 matrix of a rigid transform");
  }
  return {Eigen::Quaterniond(*rotation), m.topRightCorner<3, 1>()};
}

Numbers to_array(const Eigen::Vector3d& v) {
  Numbers out(3);
  std::copy_n(v.data(), 3, out.mutable_data());
  return out;
}

Eigen::Vector3d to_vector(const Numbers& values, const char* name) {
  require_shape(values, {3}, name);
  return {values.data()[0], values.data()[1], values.data()[2]};
}

Bytes to_array(const cv::Mat& image) {
  const int channels = image.channels();
  std::vector<py::ssize_t> shape = {image.rows, image.cols};
  if (channels == 3) shape.push_back(3);
  Bytes out(shape);
  cv::Mat pixels(image.rows, image.cols, CV_8UC(channels), out.mutable_data());
  if (channels == 3) {
    cv::cvtColor(image, pixels, cv::COLOR_BGR2RGB);
  } else {
    image.copyTo(pixels);
  }
  return out;
}

cv::Mat to_image(const Bytes& pixels) {
  const bool color = pixels.ndim() == 3 && pixels.shape(2) == 3;
  if ((!color && pixels.ndim() != 2) || pixels.size() == 0) {
    fail_input("image: expected uint8 of shape (height, width) or (height, width, 3)");
  }
  const cv::Mat view(static_cast<int>(pixels.shape(0)), static_cast<int>(pixels.shape(1)),
                     color ? CV_8UC3 : CV_8UC1, const_cast<std::uint8_t*>(pixels.data()));
  cv::Mat image;
  if (color) {
    cv::cvtColor(view, image, cv::COLOR_RGB2BGR);
  } else {
    image = view.clone();
  }
  return image;
}

py::array_t<float> to_array(const std::vector<float>& values,
                            std::initializer_list<std::size_t> shape) {
  py::array_t<float> out(std::vector<py::ssize_t>(shape.begin(), shape.end()));
  if (static_cast<std::size_t>(out.size()) != values.size()) {
    fail_input("array: {} numbers instead of {}", values.size(), out.size());
  }
  std::copy(values.begin(), values.end(), out.mutable_data());
  return out;
}

std::vector<float> to_floats(
    const py::array_t<float, py::array::c_style | py::array::forcecast>& a) {
  return {a.data(), a.data() + a.size()};
}

void require_shape(const py::array& array, std::initializer_list<py::ssize_t> shape,
                   const char* name) {
  const auto same = [](py::ssize_t wanted, py::ssize_t found) {
    return wanted < 0 || wanted == found;
  };
  if (array.ndim() == static_cast<py::ssize_t>(shape.size()) &&
      std::equal(shape.begin(), shape.end(), array.shape(), same)) {
    return;
  }
  std::string wanted;
  for (const py::ssize_t n : shape) {
    wanted += (wanted.empty() ? "" : ", ") + (n < 0 ? "n" : std::to_string(n));
  }
  fail_input("{}: expected an array of shape ({})", name, wanted);
}

}  // namespace apvi::python
