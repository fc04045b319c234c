// SPDX-License-Identifier: BSD-3-Clause
#include "io/folder/image_decode.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>
#include <opencv2/imgcodecs.hpp>

#include "apvi/core/error.hpp"
#include "io/folder/raw_encoding.hpp"
#include "support/tmp_dir.hpp"

namespace apvi::io {
namespace {

using Bytes = std::vector<std::uint8_t>;

constexpr int kSide = 8;
constexpr std::uint8_t kGray = 120;

RawImage raw_image(const std::string& encoding, std::size_t bytes_per_pixel, const Bytes& bytes) {
  RawImage raw;
  raw.name = "/cam";
  raw.encoding = encoding;
  raw.width = raw.height = kSide;
  raw.step = kSide * bytes_per_pixel;
  raw.bytes = bytes;
  return raw;
}

Bytes repeated(const Bytes& pattern, std::size_t times) {
  Bytes bytes;
  for (std::size_t i = 0; i < times; ++i) {
    bytes.insert(bytes.end(), pattern.begin(), pattern.end());
  }
  return bytes;
}

// Brightness of a uniformly gray image.
double gray_of(const cv::Mat& image) {
  EXPECT_EQ(image.size(), cv::Size(kSide, kSide));
  EXPECT_EQ(image.depth(), CV_8U);
  const cv::Scalar mean = cv::mean(image);
  if (image.channels() == 3) {
    EXPECT_NEAR(mean[0], mean[1], 1.0);
    EXPECT_NEAR(mean[0], mean[2], 1.0);
  }
  return mean[0];
}

Bytes file_of(const cv::Mat& image, const std::string& extension) {
  Bytes bytes;
  cv::imencode(extension, image, bytes);
  return bytes;
}

cv::Mat noise_image() {
  cv::Mat image(64, 64, CV_8UC1);
  cv::theRNG().state = 7;
  cv::randu(image, 0, 255);
  return image;
}

std::string error_of(const std::function<void()>& decode) {
  try {
    decode();
  } catch (const RunError& error) {
    return error.what();
  }
  return "";
}

TEST(ImageDecode, ReadsLayoutsOfUsbIndustrialAndPiCameras) {
  constexpr auto kPixels = static_cast<std::size_t>(kSide) * kSide;
  // The limited range of these YUV layouts maps 120 to 1.164 (120 - 16) = 121.
  for (const char* name : {"yuv422", "uyvy"}) {
    const RawImage raw = raw_image(name, 2, repeated({128, kGray}, kPixels));
    EXPECT_NEAR(gray_of(decode_raw_image(raw)), 121.0, 1.0) << name;
  }
  for (const char* name : {"yuv422_yuy2", "yuyv"}) {
    const RawImage raw = raw_image(name, 2, repeated({kGray, 128}, kPixels));
    EXPECT_NEAR(gray_of(decode_raw_image(raw)), 121.0, 1.0) << name;
  }
  Bytes planes = repeated({kGray}, kPixels);
  planes.resize(kPixels * 3 / 2, 128);
  for (const char* name : {"nv12", "nv21", "i420", "yuv420"}) {
    EXPECT_NEAR(gray_of(decode_raw_image(raw_image(name, 1, planes))), 121.0, 1.0) << name;
  }
  for (const char* name : {"8UC4", "bgra8", "rgba8"}) {
    const RawImage raw = raw_image(name, 4, repeated({kGray, kGray, kGray, 255}, kPixels));
    EXPECT_NEAR(gray_of(decode_raw_image(raw)), kGray, 0.1) << name;
  }
  for (const char* name : {"bayer_rggb16", "bayer_bggr16", "bayer_gbrg16", "bayer_grbg16"}) {
    const RawImage raw = raw_image(name, 2, repeated({0, kGray}, kPixels));
    EXPECT_NEAR(gray_of(decode_raw_image(raw)), kGray, 1.0) << name;
  }
}

TEST(ImageDecode, TightRowsNeedNoStep) {
  for (const std::size_t step : {0, 8, 5000}) {
    RawImage raw =
        raw_image("rgb8", 3, repeated({1, 2, 3}, static_cast<std::size_t>(kSide) * kSide));
    raw.step = step;
    EXPECT_TRUE(is_well_formed(raw)) << step;
    EXPECT_EQ(decode_raw_image(raw).at<cv::Vec3b>(7, 7), cv::Vec3b(3, 2, 1)) << step;
  }
}

TEST(ImageDecode, NamesAnUnsupportedEncoding) {
  const RawImage raw = raw_image("32FC1", 4, Bytes(256));
  const std::string error = error_of([&] { decode_raw_image(raw); });
  EXPECT_THAT(error, testing::HasSubstr("/cam: image encoding \"32FC1\""));
  EXPECT_THAT(error, testing::HasSubstr("bgr8"));
}

TEST(ImageDecode, IncompleteFilesAreErrorsThatNameTheFile) {
  const test::TmpDir tmp;
  BitDepth depth;
  for (const char* extension : {".jpg", ".png"}) {
    const Bytes whole = file_of(noise_image(), extension);
    const std::filesystem::path path = tmp.path() / (std::string("image") + extension);
    for (std::size_t size : {whole.size() / 3, whole.size() / 2, whole.size() - 2}) {
      std::ofstream(path, std::ios::binary)
          .write(reinterpret_cast<const char*>(whole.data()), static_cast<std::streamsize>(size));
      EXPECT_THAT(error_of([&] { decode_image_file(path, depth); }),
                  testing::HasSubstr(path.string() + ": the image file is incomplete"));
    }
    RawImage raw = raw_image("", 0, Bytes(whole.begin(), whole.end() - 40));
    raw.compressed = true;
    EXPECT_THAT(error_of([&] { decode_raw_image(raw); }), testing::HasSubstr("incomplete"));
  }
}

TEST(ImageDecode, FloatingPixelsAreAnErrorThatSaysSo) {
  const test::TmpDir dir;
  const auto file = dir.path() / "float.tiff";
  cv::imwrite(file.string(), cv::Mat(kSide, kSide, CV_32FC1, cv::Scalar(0.5)));
  BitDepth depth;
  EXPECT_THAT(error_of([&] { decode_image_file(file, depth); }),
              testing::HasSubstr("float.tiff: pixels of this type cannot be used"));
}

TEST(ImageDecode, CompressedMosaicsOfBayerSensorsBecomeColor) {
  cv::Mat mosaic(kSide, kSide, CV_8UC1, cv::Scalar(80));  // green
  for (int y = 0; y < kSide; y += 2) {
    for (int x = 0; x < kSide; x += 2) {
      mosaic.at<std::uint8_t>(y, x) = 200;         // red
      mosaic.at<std::uint8_t>(y + 1, x + 1) = 40;  // blue
    }
  }
  RawImage raw = raw_image("bayer_rggb8; png compressed ", 0, file_of(mosaic, ".png"));
  raw.compressed = true;
  const cv::Mat color = decode_raw_image(raw);
  ASSERT_EQ(color.channels(), 3);
  EXPECT_EQ(color.at<cv::Vec3b>(kSide / 2, kSide / 2), cv::Vec3b(40, 80, 200));
  for (const char* format : {"bayer_rggb8; png compressed mono8", "png", "mono8; png compressed"}) {
    raw.encoding = format;
    EXPECT_EQ(decode_raw_image(raw).channels(), 1) << format;
  }
}

TEST(ImageDecode, EncodingsAreKnownInUpperCase) {
  EXPECT_EQ(find_encoding("RGB8"), find_encoding("rgb8"));
  EXPECT_EQ(find_encoding("8uc3"), find_encoding("8UC3"));
  EXPECT_EQ(find_encoding("rgb9"), nullptr);
}

TEST(ImageDecode, CompleteFilesWithATrailerAreRead) {
  for (const char* extension : {".jpg", ".png", ".bmp"}) {
    RawImage raw = raw_image("", 0, file_of(noise_image(), extension));
    raw.compressed = true;
    raw.bytes.resize(raw.bytes.size() + 100, 0);  // some cameras pad their files
    EXPECT_EQ(decode_raw_image(raw).size(), cv::Size(64, 64)) << extension;
  }
}

TEST(ImageDecode, RangeOf16BitImagesIsThatOfTheRecording) {
  for (const auto& [bits, brightest] :
       {std::pair{10, 1000}, {12, 4000}, {14, 16000}, {16, 63000}}) {
    cv::Mat bright(kSide, kSide, CV_16UC1, cv::Scalar(brightest));
    const int faint = brightest / 16;
    const cv::Mat dark(kSide, kSide, CV_16UC1, cv::Scalar(faint));
    BitDepth depth;
    EXPECT_NEAR(gray_of(depth.to_eight_bits(bright)), 246.0, 7.0) << bits;
    EXPECT_EQ(depth.bits(), bits);
    // A dark image of the same camera stays dark.
    EXPECT_NEAR(gray_of(depth.to_eight_bits(dark)), 15.5, 0.6) << bits;
    const test::TmpDir tmp;
    const std::filesystem::path path = tmp.path() / "image.png";
    cv::imwrite(path.string(), bright);
    EXPECT_NEAR(gray_of(decode_image_file(path, depth)), 246.0, 7.0) << bits;
  }
}

}  // namespace
}  // namespace apvi::io
