// SPDX-License-Identifier: BSD-3-Clause
#include "io/folder/raw_encoding.hpp"

#include <algorithm>
#include <array>
#include <opencv2/imgproc.hpp>

#include "core/text.hpp"

namespace apvi::io {
namespace {

// The names of sensor_msgs/image_encodings.hpp and those of camera drivers (nv12, i420, yuyv).
// OpenCV names a Bayer pattern by the pixels of the second row, ROS by those of the first. A number
// of channels without their names (8UC3, 8UC4) is taken in OpenCV's order, as cv_bridge does.
constexpr std::array kEncodings = {
    Encoding{"mono8", CV_8UC1},
    Encoding{"8UC1", CV_8UC1},
    Encoding{"mono16", CV_16UC1},
    Encoding{"16UC1", CV_16UC1},
    Encoding{"bgr8", CV_8UC3},
    Encoding{"8UC3", CV_8UC3},
    Encoding{"rgb8", CV_8UC3, cv::COLOR_RGB2BGR},
    Encoding{"bgra8", CV_8UC4, cv::COLOR_BGRA2BGR},
    Encoding{"8UC4", CV_8UC4, cv::COLOR_BGRA2BGR},
    Encoding{"rgba8", CV_8UC4, cv::COLOR_RGBA2BGR},
    Encoding{"bgr16", CV_16UC3},
    Encoding{"16UC3", CV_16UC3},
    Encoding{"rgb16", CV_16UC3, cv::COLOR_RGB2BGR},
    Encoding{"bgra16", CV_16UC4, cv::COLOR_BGRA2BGR},
    Encoding{"16UC4", CV_16UC4, cv::COLOR_BGRA2BGR},
    Encoding{"rgba16", CV_16UC4, cv::COLOR_RGBA2BGR},
    Encoding{"bayer_rggb8", CV_8UC1, cv::COLOR_BayerBG2BGR},
    Encoding{"bayer_bggr8", CV_8UC1, cv::COLOR_BayerRG2BGR},
    Encoding{"bayer_gbrg8", CV_8UC1, cv::COLOR_BayerGR2BGR},
    Encoding{"bayer_grbg8", CV_8UC1, cv::COLOR_BayerGB2BGR},
    Encoding{"bayer_rggb16", CV_16UC1, cv::COLOR_BayerBG2BGR},
    Encoding{"bayer_bggr16", CV_16UC1, cv::COLOR_BayerRG2BGR},
    Encoding{"bayer_gbrg16", CV_16UC1, cv::COLOR_BayerGR2BGR},
    Encoding{"bayer_grbg16", CV_16UC1, cv::COLOR_BayerGB2BGR},
    Encoding{"yuv422", CV_8UC2, cv::COLOR_YUV2BGR_UYVY},
    Encoding{"uyvy", CV_8UC2, cv::COLOR_YUV2BGR_UYVY},
    Encoding{"yuv422_yuy2", CV_8UC2, cv::COLOR_YUV2BGR_YUY2},
    Encoding{"yuyv", CV_8UC2, cv::COLOR_YUV2BGR_YUY2},
    Encoding{"yuyv422", CV_8UC2, cv::COLOR_YUV2BGR_YUY2},
    Encoding{"yuy2", CV_8UC2, cv::COLOR_YUV2BGR_YUY2},
    Encoding{"yvyu", CV_8UC2, cv::COLOR_YUV2BGR_YVYU},
    Encoding{"nv12", CV_8UC1, cv::COLOR_YUV2BGR_NV12, true},
    Encoding{"nv21", CV_8UC1, cv::COLOR_YUV2BGR_NV21, true},
    Encoding{"i420", CV_8UC1, cv::COLOR_YUV2BGR_I420, true},
    Encoding{"yuv420", CV_8UC1, cv::COLOR_YUV2BGR_I420, true},
    Encoding{"yv12", CV_8UC1, cv::COLOR_YUV2BGR_YV12, true},
};

}  // namespace

const Encoding* find_encoding(std::string_view name) {
  const auto* const found = std::find_if(
      kEncodings.begin(), kEncodings.end(),
      [&](const Encoding& e) { return text::to_lower(e.name) == text::to_lower(name); });
  return found == kEncodings.end() ? nullptr : &*found;
}

}  // namespace apvi::io
