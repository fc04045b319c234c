// SPDX-License-Identifier: BSD-3-Clause
#include "runs/views/image_files.hpp"

#include <torch/torch.h>

#include <cstdlib>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <ostream>
#include <string>
#include <vector>

#include "apvi/core/error.hpp"
#include "core/atomic_file.hpp"
#include "slam/camera_conversion.hpp"

namespace apvi::runs {
namespace {

constexpr double kMillimeters = 1000.0;
constexpr double kMaxMillimeters = 65535.0;
constexpr double kMax16Bit = 65535.0;

void write_encoded(const std::filesystem::path& path, const cv::Mat& image) {
  std::vector<unsigned char> bytes;
  if (!cv::imencode(path.extension().string(), image, bytes)) {
    fail_run("{}: cannot be encoded", path.string());
  }
  write_file_atomically(path, [&bytes](std::ostream& out) {
    out.write(reinterpret_cast<const char*>(bytes.data()),
              static_cast<std::streamsize>(bytes.size()));
  });
}

}  // namespace

void write_png(const std::filesystem::path& path, const torch::Tensor& image) {
  write_encoded(path, slam::to_image(image));
}

void write_png_16(const std::filesystem::path& path, const torch::Tensor& image) {
  const torch::Tensor values =
      (image.detach().to(torch::kCPU, torch::kFloat32).clamp(0.0, 1.0) * kMax16Bit + 0.5)
          .to(torch::kInt32)
          .contiguous();
  cv::Mat rgb;
  cv::Mat(static_cast<int>(values.size(0)), static_cast<int>(values.size(1)), CV_32SC3,
          values.data_ptr())
      .convertTo(rgb, CV_16U);
  cv::Mat bgr;
  cv::cvtColor(rgb, bgr, cv::COLOR_RGB2BGR);
  write_encoded(path, bgr);
}

void write_depth_png(const std::filesystem::path& path, const torch::Tensor& depth_m) {
  const torch::Tensor mm = (depth_m.detach().to(torch::kCPU, torch::kFloat32) * kMillimeters + 0.5)
                               .clamp(0.0, kMaxMillimeters)
                               .to(torch::kInt32)
                               .contiguous();
  cv::Mat image;
  cv::Mat(static_cast<int>(mm.size(0)), static_cast<int>(mm.size(1)), CV_32S, mm.data_ptr())
      .convertTo(image, CV_16U);
  write_encoded(path, image);
}

void write_pfm(const std::filesystem::path& path, const torch::Tensor& image) {
  const bool color = image.dim() == 3;
  // PFM stores rows bottom to top.
  const torch::Tensor rows = image.detach().to(torch::kCPU, torch::kFloat32).flip({0}).contiguous();
  write_file_atomically(path, [&](std::ostream& out) {
    out << (color ? "PF\n" : "Pf\n") << rows.size(1) << " " << rows.size(0) << "\n-1.0\n";
    out.write(reinterpret_cast<const char*>(rows.data_ptr<float>()),
              static_cast<std::streamsize>(rows.nbytes()));
  });
}

void write_exr(const std::filesystem::path& path, const torch::Tensor& image) {
  ::setenv("OPENCV_IO_ENABLE_OPENEXR", "1", /*overwrite=*/0);  // off by default in OpenCV
  const torch::Tensor values = image.detach().to(torch::kCPU, torch::kFloat32).contiguous();
  const bool color = image.dim() == 3;
  const cv::Mat rgb(static_cast<int>(values.size(0)), static_cast<int>(values.size(1)),
                    color ? CV_32FC3 : CV_32FC1, values.data_ptr());
  cv::Mat stored = rgb;
  if (color) cv::cvtColor(rgb, stored, cv::COLOR_RGB2BGR);
  try {
    write_encoded(path, stored);
  } catch (const cv::Exception&) {
    fail_run("{}: this build of OpenCV cannot write OpenEXR; use --float", path.string());
  }
}

}  // namespace apvi::runs
