// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>

#include "importer/mp4_bytes.hpp"
#include "importer/photo_files.hpp"
#include "importer/photo_header.hpp"

namespace apvi::importer {
namespace {

using namespace test;

std::string exif_entry(std::uint16_t tag, std::uint16_t type, std::uint32_t count,
                       const std::string& value) {
  return big(tag) + big(type) + u32(count) + value;
}

// A JPEG header with EXIF: date, fraction of a second and 24 mm focal length.
std::string jpeg_header(const std::string& date) {
  const std::string ifd0 = big(std::uint16_t{1}) + exif_entry(0x8769, 4, 1, u32(26)) + u32(0);
  const std::string exif = big(std::uint16_t{3}) + exif_entry(0x9003, 2, 20, u32(68)) +
                           exif_entry(0x9291, 2, 3, "25" + std::string(2, '\0')) +
                           exif_entry(0xA405, 3, 1, i16(24) + i16(0)) + u32(0);
  const std::string tiff = "MM" + i16(42) + u32(8) + ifd0 + exif + date + '\0';
  const std::string app1 = std::string("Exif\0\0", 6) + tiff;
  const std::string sof = std::string(1, 8) + i16(480) + i16(640) + std::string(8, 0);
  return "\xFF\xD8\xFF\xE1" + i16(static_cast<int>(app1.size() + 2)) + app1 + "\xFF\xC0" +
         i16(static_cast<int>(sof.size() + 2)) + sof;
}

TEST(PhotoHeader, ReadsSizeTimeAndFocalLengthOfAJpeg) {
  const auto header = parse_photo_header(as_bytes(jpeg_header("2024:03:01 12:00:00")));
  ASSERT_TRUE(header);
  EXPECT_EQ(header->size.width, 640);
  EXPECT_EQ(header->size.height, 480);
  EXPECT_EQ(header->taken_ns, 1'709'294'400'250'000'000);
  EXPECT_EQ(header->focal_length_35mm, 24.0);
}

TEST(PhotoHeader, ImpossibleDatesAreNone) {
  for (const char* date : {"2024:13:01 12:00:00", "0000:00:00 00:00:00", "              :    "}) {
    const auto header = parse_photo_header(as_bytes(jpeg_header(date)));
    ASSERT_TRUE(header);
    EXPECT_FALSE(header->taken_ns.has_value()) << date;
  }
  EXPECT_FALSE(parse_photo_header(as_bytes("GIF89a")).has_value());
}

TEST(NaturalOrder, ComparesDigitsAsNumbers) {
  EXPECT_TRUE(natural_less("img2", "img10"));
  EXPECT_FALSE(natural_less("img10", "img2"));
  EXPECT_TRUE(natural_less("a", "a1"));
  EXPECT_TRUE(natural_less("img02b", "img2c"));
  EXPECT_FALSE(natural_less("x7", "x7"));
}

TEST(PhotoHeader, MarkersOfAJpegMayBeFilledUp) {
  std::string jpeg = jpeg_header("2024:03:01 12:00:00");
  jpeg.insert(jpeg.find("\xFF\xC0"), "\xFF\xFF");
  const auto header = parse_photo_header(as_bytes(jpeg));
  ASSERT_TRUE(header);
  EXPECT_EQ(header->size.width, 640);
}

}  // namespace
}  // namespace apvi::importer
