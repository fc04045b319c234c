// SPDX-License-Identifier: BSD-3-Clause
#include "io/folder/image_decode.hpp"

#include <algorithm>
#include <fstream>
#include <iterator>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <string_view>

#include "apvi/core/error.hpp"
#include "core/text.hpp"
#include "io/folder/image_file_check.hpp"
#include "io/folder/raw_encoding.hpp"

namespace apvi::io {
namespace {

constexpr int kFlags = cv::IMREAD_ANYCOLOR | cv::IMREAD_IGNORE_ORIENTATION;

cv::Mat swap_bytes(const cv::Mat& image) {
  cv::Mat swapped = image.clone();
  for (int row = 0; row < swapped.rows; ++row) {
    auto* bytes = swapped.ptr<std::uint8_t>(row);
    const std::size_t count = static_cast<std::size_t>(swapped.cols) * swapped.elemSize();
    for (std::size_t i = 0; i + 1 < count; i += 2) std::swap(bytes[i], bytes[i + 1]);
  }
  return swapped;
}

std::size_t row_bytes(const RawImage& raw, const Encoding& encoding) {
  return raw.width * static_cast<std::size_t>(CV_ELEM_SIZE(encoding.type));
}

// Some drivers leave the step at zero or write the width into it. Where the data have exactly the
// size of rows without padding, the step is known.
std::size_t step_of(const RawImage& raw, const Encoding& encoding) {
  const std::size_t row = row_bytes(raw, encoding);
  return raw.bytes.size() == row * encoding.rows(raw.height) ? row : raw.step;
}

cv::Mat decode_rows(const RawImage& raw) {
  const Encoding* encoding = find_encoding(raw.encoding);
  if (encoding == nullptr) {
    fail_run(
        "{}: image encoding \"{}\" is not supported; publish mono8, bgr8, a Bayer pattern, yuv422 "
        "or nv12, or compressed images",
        raw.name, raw.encoding);
  }
  if (!is_well_formed(raw)) fail_run("{}: the image is truncated", raw.name);
  // cv::Mat has no const view; the pixels are only read, and copied below.
  cv::Mat image(static_cast<int>(encoding->rows(raw.height)), static_cast<int>(raw.width),
                encoding->type, const_cast<std::uint8_t*>(raw.bytes.data()),
                step_of(raw, *encoding));
  if (image.depth() == CV_16U) {
    image = raw.depth->to_eight_bits(raw.big_endian ? swap_bytes(image) : image);
  }
  if (encoding->conversion == kNoConversion) return image.clone();
  cv::Mat converted;
  cv::cvtColor(image, converted, encoding->conversion);
  return converted;
}

// With 16 bits per value where the file has them; OpenCV would keep the upper eight bits of these,
// which is black for a camera of 10 bits.
cv::Mat decode_file(const std::vector<std::uint8_t>& bytes, const std::string& name,
                    BitDepth& depth) {
  if (!is_complete_image_file(bytes)) fail_run("{}: the image file is incomplete", name);
  cv::Mat image = bytes.empty() ? cv::Mat() : cv::imdecode(bytes, kFlags | cv::IMREAD_ANYDEPTH);
  if (!image.empty() && image.depth() == CV_16U) return depth.to_eight_bits(image);
  const bool other_type = !image.empty() && image.depth() != CV_8U;
  if (other_type) image = cv::imdecode(bytes, kFlags);
  if (image.empty() && other_type) {
    fail_run("{}: pixels of this type cannot be used; save the image with 8 or 16 bits", name);
  }
  if (image.empty()) fail_run("{}: cannot decode this image; it may be damaged", name);
  return image;
}

// Transports of images compress the mosaic of a Bayer sensor as a gray image, and name its pattern
// in the format only. Color files and those called mono were converted before.
cv::Mat without_mosaic(const cv::Mat& image, std::string_view format) {
  const std::size_t end = std::min(format.find(';'), format.size());
  const Encoding* encoding = find_encoding(text::trim(format.substr(0, end)));
  if (encoding == nullptr || !encoding->is_bayer() || image.channels() != 1) return image;
  if (format.substr(end).find("mono") != std::string_view::npos) return image;
  cv::Mat color;
  cv::cvtColor(image, color, encoding->conversion);
  return color;
}

}  // namespace

cv::Mat decode_image_file(const std::filesystem::path& path, BitDepth& depth) {
  std::ifstream in(path, std::ios::binary);
  const std::vector<std::uint8_t> bytes{std::istreambuf_iterator<char>(in), {}};
  if (in.bad() || bytes.empty())
    fail_run("{}: the image file is empty or unreadable", path.string());
  try {
    return decode_file(bytes, path.string(), depth);
  } catch (const cv::Exception& e) {
    fail_run("{}: cannot decode this image: {}", path.string(), e.err);
  }
}

bool is_well_formed(const RawImage& raw) {
  constexpr std::size_t kMaxSide = 100'000;
  if (raw.width == 0 || raw.height == 0) return false;
  if (raw.width > kMaxSide || raw.height > kMaxSide) return false;
  const Encoding* encoding = find_encoding(raw.encoding);
  if (encoding == nullptr) return true;
  const std::size_t row = row_bytes(raw, *encoding);
  const std::size_t step = step_of(raw, *encoding);
  return step >= row && step <= raw.bytes.size() &&
         step * (encoding->rows(raw.height) - 1) + row <= raw.bytes.size();
}

cv::Mat decode_raw_image(const RawImage& raw) {
  try {
    if (!raw.compressed) return decode_rows(raw);
    return without_mosaic(decode_file(raw.bytes, raw.name, *raw.depth), raw.encoding);
  } catch (const cv::Exception& e) {
    fail_run("{}: cannot decode this image: {}", raw.name, e.err);
  }
}

}  // namespace apvi::io
