// SPDX-License-Identifier: BSD-3-Clause
#include "map_io/compressed_ply.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <torch/torch.h>

#include <cmath>
#include <string>

#include "apvi/core/error.hpp"
#include "map_io/map_file.hpp"
#include "map_io/ply.hpp"
#include "support/tmp_dir.hpp"
#include "support/torch_reference.hpp"

namespace apvi::map_io {
namespace {

using test::tensors_near;
using test::TmpDir;
using testing::HasSubstr;
using torch::Tensor;

template <typename T>
void append(std::string& bytes, T value) {
  bytes.append(reinterpret_cast<const char*>(&value), sizeof(T));
}

std::string header(int chunks, int vertices, bool colored, int sh) {
  std::string text =
      "ply\nformat binary_little_endian 1.0\nelement chunk " + std::to_string(chunks) + "\n";
  for (const char* name :
       {"min_x", "min_y", "min_z", "max_x", "max_y", "max_z", "min_scale_x", "min_scale_y",
        "min_scale_z", "max_scale_x", "max_scale_y", "max_scale_z"}) {
    text += std::string("property float ") + name + "\n";
  }
  for (const char* name : {"min_r", "min_g", "min_b", "max_r", "max_g", "max_b"}) {
    if (colored) text += std::string("property float ") + name + "\n";
  }
  text += "element vertex " + std::to_string(vertices) + "\n";
  for (const char* name : {"packed_position", "packed_rotation", "packed_scale", "packed_color"}) {
    text += std::string("property uint ") + name + "\n";
  }
  if (sh > 0) text += "element sh " + std::to_string(vertices) + "\n";
  for (int i = 0; i < sh; ++i) text += "property uchar f_rest_" + std::to_string(i) + "\n";
  return text + "end_header\n";
}

// One Gaussian: position at (max, min, half), the x component of the rotation the largest.
std::string one_gaussian(bool colored) {
  std::string bytes = header(1, 1, colored, 9);
  for (const float bound : {-1.0F, 2.0F, 10.0F, 3.0F, 4.0F, 20.0F}) append(bytes, bound);
  for (const float bound : {-6.0F, -5.0F, -4.0F, -2.0F, -1.0F, 0.0F}) append(bytes, bound);
  if (colored) {
    for (const float bound : {0.0F, -1.0F, 0.5F, 1.0F, 3.0F, 1.5F}) append(bytes, bound);
  }
  append(bytes, 2047U << 21U | 0U << 11U | 1024U);
  append(bytes, 1U << 30U | 1023U << 20U | 0U << 10U | 512U);  // w, y, z
  append(bytes, 0U << 21U | 1023U << 11U | 0U);
  append(bytes, 255U << 24U | 0U << 16U | 51U << 8U | 204U);
  for (int i = 0; i < 9; ++i) append(bytes, static_cast<unsigned char>(i == 4 ? 191 : 16 * i));
  return bytes;
}

TEST(CompressedPly, ReadsHandMadeGaussian) {
  const TmpDir dir;
  const gaussians::Gaussians g = read_ply(dir.write("a.compressed.ply", one_gaussian(true)));
  ASSERT_EQ(g.size(), 1);
  EXPECT_TRUE(tensors_near(g.means, torch::tensor({{3.0F, 2.0F, 10.0F + 10240.0F / 2047}}), 1e-5));
  EXPECT_TRUE(tensors_near(g.log_scales, torch::tensor({{-6.0F, -1.0F, -4.0F}}), 1e-6));
  const double root = std::sqrt(0.5);
  const double z = (512.0 / 1023 - 0.5) / root;  // w and y are at the ends: +/- sqrt(1/2)
  EXPECT_TRUE(tensors_near(g.quaternions,
                           torch::tensor({{root, 0.0, -root, z}}).to(torch::kFloat32), 1e-5));
  EXPECT_TRUE(
      tensors_near(gaussians::sh_dc_to_color(g.sh_dc), torch::tensor({{1.0F, -1.0F, 0.7F}}), 1e-5));
  EXPECT_NEAR(g.logit_opacities[0].item<float>(), std::log(0.8 / 0.2), 1e-5);
  ASSERT_EQ(g.sh_rest.sizes(), at::IntArrayRef({1, 3, 3}));
  EXPECT_FLOAT_EQ(g.sh_rest[0][0][0].item<float>(), -4.0F);                         // byte 0
  EXPECT_FLOAT_EQ(g.sh_rest[0][1][1].item<float>(), 8.0F * (191.5F / 256 - 0.5F));  // f_rest_4
  EXPECT_FLOAT_EQ(g.sh_rest[0][2][0].item<float>(), 8.0F * (32.5F / 256 - 0.5F));   // f_rest_2
}

TEST(CompressedPly, ColorsWithoutBoundsAreFractions) {
  const TmpDir dir;
  const gaussians::Gaussians g = read_ply(dir.write("a.compressed.ply", one_gaussian(false)));
  EXPECT_TRUE(
      tensors_near(gaussians::sh_dc_to_color(g.sh_dc), torch::tensor({{1.0F, 0.0F, 0.2F}}), 1e-6));
}

gaussians::Gaussians random_map(std::int64_t count, int degree) {
  torch::manual_seed(3);
  return {.means = 5.0 * torch::randn({count, 3}),
          .log_scales = torch::randn({count, 3}) - 3.0,
          .quaternions = torch::randn({count, 4}),
          .logit_opacities = 2.0 * torch::randn({count}),
          .sh_dc = torch::randn({count, 3}),
          .sh_rest = 0.3 * torch::randn({count, gaussians::sh_rest_count(degree), 3})};
}

// The extent of a whole map bounds that of a chunk.
double extent(const Tensor& values) {
  return (values.amax(0) - values.amin(0)).max().item<double>();
}

double worst(const Tensor& a, const Tensor& b) {
  return a.numel() == 0 ? 0.0 : (a - b).abs().max().item<double>();
}

TEST(CompressedPly, RoundTripStaysWithinQuantization) {
  const TmpDir dir;
  for (const int degree : {0, 1, 2, 3}) {
    const gaussians::Gaussians map = random_map(700, degree);  // the last chunk is not full
    const MapFile file{.gaussians = map, .medium = std::nullopt, .origin = {5e5, 6e6, 0.5}};
    write_map(dir.path() / "a.compressed.ply", file);
    const MapFile again = read_map(dir.path() / "a.compressed.ply");
    EXPECT_EQ(again.origin, file.origin);
    const gaussians::Gaussians& read = again.gaussians;
    ASSERT_EQ(read.size(), 700);
    const Tensor order = torch::cdist(map.means, read.means).argmin(1);
    const auto row = [&](const Tensor& t) { return t.index({order}); };
    EXPECT_LT(worst(row(read.means), map.means), 0.51 * extent(map.means) / 1023);
    EXPECT_LT(worst(row(read.log_scales), map.log_scales), 0.51 * extent(map.log_scales) / 1023);
    const Tensor unit = map.quaternions / map.quaternions.norm(2, 1, true);
    const Tensor cosine = (row(read.quaternions) * unit).sum(1).abs();
    EXPECT_GT(cosine.min().item<double>(), 1.0 - 4e-6);
    EXPECT_LT(worst(row(read.sh_dc), map.sh_dc), 0.51 * extent(map.sh_dc) / 255);
    EXPECT_LT(worst(torch::sigmoid(row(read.logit_opacities)), torch::sigmoid(map.logit_opacities)),
              0.51 / 255);
    EXPECT_LT(worst(row(read.sh_rest), map.sh_rest), 0.51 * 8.0 / 256);
  }
}

TEST(CompressedPly, RoundTripsEmptyMapAndMedium) {
  const TmpDir dir;
  const MapFile file{.gaussians = random_map(0, 1),
                     .medium = medium::Medium{.beta_d = torch::tensor({0.4F, 0.12F, 0.08F}),
                                              .beta_b = torch::tensor({0.3F, 0.15F, 0.1F}),
                                              .b_inf = torch::tensor({0.05F, 0.3F, 0.4F})}};
  write_map(dir.path() / "a.compressed.ply", file);
  const MapFile read = read_map(dir.path() / "a.compressed.ply");
  EXPECT_EQ(read.gaussians.size(), 0);
  ASSERT_TRUE(read.medium);
  EXPECT_TRUE(torch::equal(read.medium->beta_b, file.medium->beta_b));
}

TEST(CompressedPly, RejectsTooFewChunksAndRows) {
  const TmpDir dir;
  const auto error = [&](const std::string& bytes) -> std::string {
    try {
      read_ply(dir.write("a.ply", bytes));
    } catch (const InputError& e) {
      return e.what();
    }
    return "no error";
  };
  EXPECT_THAT(error(header(1, 257, false, 0) + std::string(48 + 257 * 16, '\0')),
              HasSubstr("1 chunks for 257 Gaussians"));
  EXPECT_THAT(error(header(1, 2, false, 0) + std::string(48 + 16, '\0')), HasSubstr("truncated"));
  EXPECT_THAT(error(header(1, 1, false, 7) + std::string(48 + 16 + 7, '\0')),
              HasSubstr("element sh has 7 properties"));
}

}  // namespace
}  // namespace apvi::map_io
