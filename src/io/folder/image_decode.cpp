// SPDX-License-Identifier: BSD-3-Clause
#include "io/folder/image_decode.hpp"

#include <algorithm>
#include <array>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <string_view>

#include "apvi/core/error.hpp"

namespace apvi::io {
namespace {

constexpr int kFlags = cv::IMREAD_ANYCOLOR | cv::IMREAD_IGNORE_ORIENTATION;
constexpr int kNoConversion = -1;

struct Encoding {
  std::string_view name;
  int type;
  int conversion;  // to gray or BGR
};

// OpenCV names a Bayer pattern by the pixels of the second row, ROS by those of the first.
constexpr std::array<Encoding, 16> kEncodings = {{
    {"mono8", CV_8UC1, kNoConversion},
    {"8UC1", CV_8UC1, kNoConversion},
    {"mono16", CV_16UC1, kNoConversion},
    {"16UC1", CV_16UC1, kNoConversion},
    {"bgr8", CV_8UC3, kNoConversion},
    {"8UC3", CV_8UC3, kNoConversion},
    {"rgb8", CV_8UC3, cv::COLOR_RGB2BGR},
    {"bgra8", CV_8UC4, cv::COLOR_BGRA2BGR},
    {"rgba8", CV_8UC4, cv::COLOR_RGBA2BGR},
    {"bgr16", CV_16UC3, kNoConversion},
    {"rgb16", CV_16UC3, cv::COLOR_RGB2BGR},
    {"bayer_rggb8", CV_8UC1, cv::COLOR_BayerBG2BGR},
    {"bayer_bggr8", CV_8UC1, cv::COLOR_BayerRG2BGR},
    {"bayer_gbrg8", CV_8UC1, cv::COLOR_BayerGR2BGR},
    {"bayer_grbg8", CV_8UC1, cv::COLOR_BayerGB2BGR},
    {"bayer_rggb16", CV_16UC1, cv::COLOR_BayerBG2BGR},
}};

const Encoding* find_encoding(std::string_view name) {
  const auto it = std::find_if(kEncodings.begin(), kEncodings.end(),
                               [&](const Encoding& e) { return e.name == name; });
  return it == kEncodings.end() ? nullptr : &*it;
}

cv::Mat swap_bytes(const cv::Mat& image) {
  cv::Mat swapped = image.clone();
  for (int row = 0; row < swapped.rows; ++row) {
    auto* bytes = swapped.ptr<std::uint8_t>(row);
    const std::size_t count = static_cast<std::size_t>(swapped.cols) * swapped.elemSize();
    for (std::size_t i = 0; i + 1 < count; i += 2) std::swap(bytes[i], bytes[i + 1]);
  }
  return swapped;
}

cv::Mat decode_rows(const RawImage& raw) {
  if (!is_well_formed(raw))
    fail_run("{}: the image is truncated or has an unknown encoding", raw.name);
  const Encoding& encoding = *find_encoding(raw.encoding);
  // cv::Mat has no const view; the pixels are only read, and copied below.
  cv::Mat image(static_cast<int>(raw.height), static_cast<int>(raw.width), encoding.type,
                const_cast<std::uint8_t*>(raw.bytes.data()), raw.step);
  if (image.depth() == CV_16U) {
    if (raw.big_endian) image = swap_bytes(image);
    cv::Mat eight_bit;
    image.convertTo(eight_bit, CV_8U, 1.0 / 256.0);
    image = eight_bit;
  }
  if (encoding.conversion == kNoConversion) return image.clone();
  cv::Mat converted;
  cv::cvtColor(image, converted, encoding.conversion);
  return converted;
}

}  // namespace

cv::Mat decode_image_file(const std::filesystem::path& path) {
  cv::Mat image;
  try {
    image = cv::imread(path.string(), kFlags);
  } catch (const cv::Exception& e) {
    fail_run("{}: cannot decode this image: {}", path.string(), e.err);
  }
  if (image.empty())
    fail_run("{}: cannot decode this image; the file may be damaged", path.string());
  return image;
}

bool is_well_formed(const RawImage& raw) {
  const Encoding* encoding = find_encoding(raw.encoding);
  constexpr std::size_t kMaxSide = 100'000;
  if (encoding == nullptr || raw.width == 0 || raw.height == 0) return false;
  if (raw.width > kMaxSide || raw.height > kMaxSide) return false;
  const std::size_t row = raw.width * static_cast<std::size_t>(CV_ELEM_SIZE(encoding->type));
  return raw.step >= row && raw.step <= raw.bytes.size() &&
         raw.step * (raw.height - 1) + row <= raw.bytes.size();
}

cv::Mat decode_raw_image(const RawImage& raw) {
  try {
    if (!raw.compressed) return decode_rows(raw);
    cv::Mat image = cv::imdecode(raw.bytes, kFlags);
    if (image.empty())
      fail_run("{}: cannot decode this image; the recording may be damaged", raw.name);
    return image;
  } catch (const cv::Exception& e) {
    fail_run("{}: cannot decode this image: {}", raw.name, e.err);
  }
}

}  // namespace apvi::io
