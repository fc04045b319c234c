// SPDX-License-Identifier: BSD-3-Clause
#include "map_io/spz.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <torch/torch.h>

#include <cmath>
#include <cstdint>
#include <sstream>
#include <string>
#include <vector>

#include "apvi/core/error.hpp"
#include "gaussians/render/sh_math.hpp"
#include "map_io/gzip.hpp"
#include "map_io/map_file.hpp"
#include "support/tmp_dir.hpp"

namespace apvi::map_io {
namespace {

using test::TmpDir;
using testing::HasSubstr;
using torch::Tensor;
using Bytes = std::vector<unsigned char>;

std::string gzip(const Bytes& bytes) {
  std::ostringstream out;
  write_gzip(out, bytes);
  return out.str();
}

SpzSplats read(const std::string& file) {
  return read_spz({file.begin(), file.end()}, "a.spz");
}

std::string error_of(const std::string& file) {
  try {
    read(file);
  } catch (const InputError& e) {
    return e.what();
  }
  return "no error";
}

Bytes header(unsigned char version, unsigned char count, unsigned char degree,
             unsigned char fractional_bits, unsigned char flags = 0) {
  return {'N', 'G', 'S', 'P', version, 0, 0, 0, count, 0, 0, 0, degree, fractional_bits, flags, 0};
}

void append(Bytes& bytes, std::initializer_list<int> more) {
  for (const int byte : more) bytes.push_back(static_cast<unsigned char>(byte));
}

// Attributes of one Gaussian up to the scales: 1.5, -0.25, 2 m with eight fractional bits.
Bytes one_gaussian(unsigned char version, unsigned char degree) {
  Bytes bytes = header(version, 1, degree, 8, 1);
  append(bytes, {0x80, 0x01, 0x00, 0xc0, 0xff, 0xff, 0x00, 0x02, 0x00});
  append(bytes, {204});
  append(bytes, {255, 0, 51});
  append(bytes, {0, 160, 80});
  return bytes;
}

TEST(Spz, ReadsHandMadeGaussianOfVersionTwo) {
  Bytes bytes = one_gaussian(2, 1);
  append(bytes, {255, 0, 128});                               // x = 1, y = -1, z = 1/255
  append(bytes, {0, 128, 255, 64, 128, 192, 136, 128, 120});  // degree 1, by coefficient
  const SpzSplats map = read(gzip(bytes));
  const Splats& s = map.splats;
  ASSERT_EQ(s.count, 1U);
  EXPECT_TRUE(map.antialiased);
  EXPECT_EQ(s.means, (std::vector<float>{1.5F, 0.25F, -2.0F}));  // y and z change their signs
  EXPECT_NEAR(s.logit_opacities[0], std::log(0.8 / 0.2), 1e-6);
  EXPECT_NEAR(s.sh_dc[0], 0.5 / 0.15, 1e-5);
  EXPECT_NEAR(s.sh_dc[2], -0.3 / 0.15, 1e-5);
  EXPECT_EQ(s.log_scales, (std::vector<float>{-10.0F, 0.0F, -5.0F}));
  EXPECT_NEAR(s.quaternions[0], 0.0, 1e-6);
  EXPECT_NEAR(s.quaternions[1], 1.0, 1e-6);
  EXPECT_NEAR(s.quaternions[2], 1.0, 1e-6);
  EXPECT_NEAR(s.quaternions[3], -1.0 / 255, 1e-6);
  ASSERT_EQ(s.rest, 3U);
  EXPECT_EQ(s.sh_rest[0], 1.0F);  // -1 of the function of y
  EXPECT_EQ(s.sh_rest[2], -127.0F / 128.0F);
  EXPECT_EQ(s.sh_rest[3], 0.5F);           // -0.5 of the function of z
  EXPECT_EQ(s.sh_rest[6], 8.0F / 128.0F);  // of the function of x, as it is
}

TEST(Spz, ReadsHandMadeRotationOfVersionThree) {
  Bytes bytes = one_gaussian(3, 0);
  // x y z w: w is the largest; x = 511, y = -256, z = 0 of 511 parts of sqrt(1/2).
  const std::uint32_t word = 3U << 30U | 511U << 20U | (512U | 256U) << 10U;
  for (unsigned shift = 0; shift < 32; shift += 8) {
    bytes.push_back(static_cast<unsigned char>(word >> shift & 255U));
  }
  const SpzSplats map = read(gzip(bytes));
  const double x = std::sqrt(0.5);
  const double y = 256.0 / 511.0 * std::sqrt(0.5);
  const auto& q = map.splats.quaternions;
  EXPECT_NEAR(q[0], std::sqrt(1.0 - x * x - y * y), 1e-6);
  EXPECT_NEAR(q[1], x, 1e-6);
  EXPECT_NEAR(q[2], y, 1e-6);  // negative in the file's axes
  EXPECT_NEAR(q[3], 0.0, 1e-6);
}

// The color toward a direction is that of the file's function toward the direction in its axes.
TEST(Spz, CoefficientsKeepColorsUnderChangeOfAxes) {
  Bytes bytes = one_gaussian(3, 3);
  append(bytes, {0, 0, 0, 192});
  double stored[15];
  for (int k = 0; k < 15; ++k) {
    append(bytes, {60 + 9 * k, 128, 128});
    stored[k] = (60 + 9 * k - 128) / 128.0;
  }
  const SpzSplats map = read(gzip(bytes));
  double in_file[15];
  double in_map[15];
  gaussians::sh_basis(3, 0.48, 0.6, 0.64, in_map);
  gaussians::sh_basis(3, 0.48, -0.6, -0.64, in_file);
  double expected = 0.0;
  double color = 0.0;
  for (std::size_t k = 0; k < 15; ++k) {
    expected += stored[k] * in_file[k];
    color += static_cast<double>(map.splats.sh_rest[3 * k]) * in_map[k];
  }
  EXPECT_NEAR(color, expected, 1e-6);
  EXPECT_GT(std::abs(expected), 0.01);
}

gaussians::Gaussians random_map(int degree, double extent) {
  torch::manual_seed(3);
  constexpr std::int64_t kCount = 500;
  return {.means = extent * (torch::rand({kCount, 3}) - 0.5),
          .log_scales = torch::randn({kCount, 3}) - 3.0,
          .quaternions = torch::randn({kCount, 4}),
          .logit_opacities = 2.0 * torch::randn({kCount}),
          .sh_dc = 6.0 * (torch::rand({kCount, 3}) - 0.5),
          .sh_rest = 1.8 * (torch::rand({kCount, gaussians::sh_rest_count(degree), 3}) - 0.5)};
}

double worst(const Tensor& a, const Tensor& b) {
  return a.numel() == 0 ? 0.0 : (a - b).abs().max().item<double>();
}

TEST(Spz, RoundTripStaysWithinQuantization) {
  const TmpDir dir;
  for (const int degree : {0, 1, 2, 3}) {
    const gaussians::Gaussians map = random_map(degree, 40.0);
    write_map(dir.path() / "a.spz", {.gaussians = map, .medium = {}, .antialiased = true});
    const MapFile file = read_map(dir.path() / "a.spz");
    EXPECT_TRUE(file.antialiased);
    EXPECT_TRUE(is_zero(file.origin));
    const gaussians::Gaussians& read = file.gaussians;
    EXPECT_LT(worst(read.means, map.means), 0.51 / 4096);
    EXPECT_LT(worst(read.log_scales, map.log_scales), 0.51 / 16);
    const Tensor unit = map.quaternions / map.quaternions.norm(2, 1, true);
    EXPECT_GT((read.quaternions * unit).sum(1).abs().min().item<double>(), 1.0 - 1e-5);
    EXPECT_LT(worst(read.sh_dc, map.sh_dc), 0.51 / (255 * 0.15));
    EXPECT_LT(worst(torch::sigmoid(read.logit_opacities), torch::sigmoid(map.logit_opacities)),
              0.51 / 255);
    EXPECT_LT(worst(read.sh_rest, map.sh_rest), 8.6 / 128);  // half a bucket and half a step
  }
}

TEST(Spz, LargeMapsHaveFewerFractionalBits) {
  const TmpDir dir;
  const gaussians::Gaussians map = random_map(0, 20000.0);  // 2^23 / 10000 m: 9 bits
  write_map(dir.path() / "a.spz", {.gaussians = map, .medium = {}});
  EXPECT_LT(worst(read_map(dir.path() / "a.spz").gaussians.means, map.means), 0.6 / 512);
  EXPECT_THROW(write_map(dir.path() / "b.spz", {.gaussians = random_map(0, 1e9), .medium = {}}),
               InputError);
}

TEST(Spz, OriginIsInSidecar) {
  const TmpDir dir;
  MapFile map{.gaussians = random_map(0, 4.0), .medium = {}, .origin = {596000.0, 6640000.0, 0.0}};
  write_map(dir.path() / "a.spz", map);
  EXPECT_EQ(read_map(dir.path() / "a.spz").origin, map.origin);
  map.origin = {};
  write_map(dir.path() / "a.spz", map);
  EXPECT_TRUE(is_zero(read_map(dir.path() / "a.spz").origin));
}

TEST(Spz, RejectsOtherAndDamagedFiles) {
  EXPECT_THAT(error_of("NGSP is not compressed"), HasSubstr("damaged"));
  EXPECT_THAT(error_of(gzip({'h', 'e', 'l', 'l', 'o'})), HasSubstr("end early"));
  EXPECT_THAT(error_of(gzip(Bytes(16, 'x'))), HasSubstr("not an SPZ file"));
  EXPECT_THAT(error_of(gzip(header(9, 0, 0, 12))), HasSubstr("version 9 of SPZ"));
  EXPECT_THAT(error_of(gzip(header(3, 0, 7, 12))), HasSubstr("SH of degree 7"));
  EXPECT_THAT(error_of(gzip(header(3, 0, 0, 24))), HasSubstr("24 fractional bits"));
  EXPECT_THAT(error_of(gzip(header(3, 1, 0, 12))), HasSubstr("end early"));
  Bytes many = header(3, 0, 0, 12);
  many[11] = 0x40;  // a billion Gaussians
  EXPECT_THAT(error_of(gzip(many)), HasSubstr("more than"));
  const std::string whole = gzip(one_gaussian(3, 0));
  EXPECT_THAT(error_of(whole.substr(0, whole.size() / 2)), HasSubstr("truncated"));
}

TEST(MapFile, RejectsUnknownEnding) {
  const TmpDir dir;
  EXPECT_THROW(write_map(dir.path() / "map.obj", {.gaussians = random_map(0, 1.0), .medium = {}}),
               InputError);
  EXPECT_FALSE(is_map_name("folder"));
  EXPECT_TRUE(is_map_name("a/B.SPZ"));
}

}  // namespace
}  // namespace apvi::map_io
