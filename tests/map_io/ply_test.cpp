// SPDX-License-Identifier: BSD-3-Clause
#include "map_io/ply.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <torch/torch.h>

#include <algorithm>
#include <cstring>
#include <fstream>
#include <limits>
#include <string>
#include <vector>

#include "apvi/core/error.hpp"
#include "map_io/map_file.hpp"
#include "support/test_data.hpp"
#include "support/tmp_dir.hpp"
#include "support/torch_reference.hpp"

namespace apvi::map_io {
namespace {

namespace fs = std::filesystem;
using test::tensors_near;
using test::TmpDir;
using testing::HasSubstr;

gaussians::Gaussians random_map(std::int64_t count, int degree) {
  torch::manual_seed(3);
  return {.means = torch::randn({count, 3}),
          .log_scales = torch::randn({count, 3}),
          .quaternions = torch::randn({count, 4}),
          .logit_opacities = torch::randn({count}),
          .sh_dc = torch::randn({count, 3}),
          .sh_rest = torch::randn({count, gaussians::sh_rest_count(degree), 3})};
}

void expect_equal(const gaussians::Gaussians& a, const gaussians::Gaussians& b) {
  const auto x = a.tensors();
  const auto y = b.tensors();
  for (std::size_t i = 0; i < x.size(); ++i) EXPECT_TRUE(torch::equal(*x[i], *y[i])) << i;
}

std::string error_of(const fs::path& file) {
  try {
    read_ply(file);
  } catch (const InputError& e) {
    return e.what();
  }
  return "no error";
}

const std::vector<std::string>& required_properties() {
  static const std::vector<std::string> names = {
      "x",       "y",       "z",       "f_dc_0", "f_dc_1", "f_dc_2", "opacity",
      "scale_0", "scale_1", "scale_2", "rot_0",  "rot_1",  "rot_2",  "rot_3"};
  return names;
}

std::string header(const std::string& format, const std::string& count,
                   const std::vector<std::string>& names, const std::string& type = "float") {
  std::string text = "ply\nformat " + format + " 1.0\nelement vertex " + count + "\n";
  for (const std::string& name : names) text += "property " + type + " " + name + "\n";
  return text + "end_header\n";
}

TEST(Ply, RoundTripIsBitwiseExactForEveryDegree) {
  const TmpDir dir;
  for (const int degree : {0, 1, 2, 3}) {
    const gaussians::Gaussians map = random_map(5000, degree);  // more than one batch of rows
    write_ply(dir.path() / "map.ply", map);
    expect_equal(read_ply(dir.path() / "map.ply"), map);
  }
}

TEST(Ply, WritesReferenceHeader) {
  const TmpDir dir;
  const fs::path file = dir.path() / "map.ply";
  write_ply(file, random_map(2, 1));
  std::ifstream in(file, std::ios::binary);
  std::string line;
  std::string names;
  while (std::getline(in, line) && line != "end_header") {
    if (line.rfind("property float ", 0) == 0) names += line.substr(15) + " ";
  }
  EXPECT_EQ(names,
            "x y z nx ny nz f_dc_0 f_dc_1 f_dc_2 f_rest_0 f_rest_1 f_rest_2 f_rest_3 f_rest_4 "
            "f_rest_5 f_rest_6 f_rest_7 f_rest_8 opacity scale_0 scale_1 scale_2 rot_0 rot_1 rot_2 "
            "rot_3 ");
}

TEST(Ply, WritesShCoefficientsChannelByChannel) {
  const TmpDir dir;
  gaussians::Gaussians map = random_map(1, 1);
  for (int i = 0; i < 3; ++i) {
    for (int channel = 0; channel < 3; ++channel) map.sh_rest[0][i][channel] = 10 * channel + i;
  }
  const fs::path file = dir.path() / "map.ply";
  write_ply(file, map);
  std::ifstream in(file, std::ios::binary);
  const std::string content((std::istreambuf_iterator<char>(in)), {});
  float rest[9];
  std::memcpy(rest, content.data() + content.size() - 17 * sizeof(float), sizeof(rest));
  EXPECT_THAT(rest, testing::ElementsAre(0, 1, 2, 10, 11, 12, 20, 21, 22));
}

TEST(Ply, ReadsPropertiesInAnyOrderAndSkipsUnknownOnes) {
  const TmpDir dir;
  std::vector<std::string> names = required_properties();
  std::reverse(names.begin(), names.end());
  names.insert(names.begin() + 3, "semantic");
  std::string row;
  for (std::size_t i = 0; i < names.size(); ++i) row += std::to_string(i) + ".5 ";
  const fs::path file = dir.write("map.ply", header("ascii", "1", names) + row + "\n");
  const gaussians::Gaussians map = read_ply(file);
  EXPECT_EQ(map.quaternions[0][3].item<float>(), 0.5F);
  EXPECT_EQ(map.quaternions[0][0].item<float>(), 4.5F);
  EXPECT_EQ(map.means[0][0].item<float>(), 14.5F);
  EXPECT_EQ(map.sh_rest.sizes(), at::IntArrayRef({1, 0, 3}));
}

TEST(Ply, ReadsBigEndianDoubles) {
  const TmpDir dir;
  std::string content = header("binary_big_endian", "2", required_properties(), "double");
  for (int i = 0; i < 28; ++i) {
    const double value = 1.0 + 0.25 * i;
    char bytes[8];
    std::memcpy(bytes, &value, 8);
    std::reverse(bytes, bytes + 8);
    content.append(bytes, 8);
  }
  const gaussians::Gaussians map = read_ply(dir.write("map.ply", content));
  EXPECT_EQ(map.means[1][2].item<float>(), 1.0F + 0.25F * 16);
  EXPECT_EQ(map.quaternions[1][3].item<float>(), 1.0F + 0.25F * 27);
}

TEST(Ply, RoundTripsMediumAndLamp) {
  const TmpDir dir;
  const fs::path file = dir.path() / "map.ply";
  medium::Medium water = {.beta_d = torch::tensor({0.40F, 0.12F, 0.08F}),
                          .beta_b = torch::tensor({0.30F, 0.15F, 0.10F}),
                          .b_inf = torch::tensor({0.05F, 0.30F, 0.40F})};
  write_ply(file, random_map(2, 0), water);
  const auto read = read_ply_medium(file);
  ASSERT_TRUE(read);
  EXPECT_TRUE(torch::equal(read->beta_d, water.beta_d));
  EXPECT_TRUE(torch::equal(read->beta_b, water.beta_b));
  EXPECT_TRUE(torch::equal(read->b_inf, water.b_inf));
  EXPECT_FALSE(read->lamp);
  water.lamp = medium::LampLight{.lamps = {{.position_m = {0.25, -0.15, 0.0}}, {.share = 0.5}},
                                 .unit_range_m = 1.25,
                                 .daylight = torch::tensor({0.1, 0.2, 0.3}, torch::kFloat64),
                                 .backscatter = torch::tensor({0.01, 0.02, 0.03}, torch::kFloat64)};
  write_ply(file, random_map(2, 0), water);
  const auto lit = read_ply_medium(file);
  ASSERT_TRUE(lit && lit->lamp);
  EXPECT_TRUE(torch::allclose(medium::lamp_to_tensor(*lit->lamp),
                              medium::lamp_to_tensor(*water.lamp), 1e-8, 1e-12));
  write_ply(file, random_map(2, 0));
  EXPECT_FALSE(read_ply_medium(file));
}

TEST(Ply, RoundTripsTheCameraResponse) {
  const TmpDir dir;
  const fs::path file = dir.path() / "map.ply";
  MapFile map{.gaussians = random_map(2, 0)};
  map.tone_curve = gaussians::kSrgb;
  map.vignetting = {.square = 0.25, .fourth = -0.03};
  write_map(file, map);
  const MapFile read = read_map(file);
  EXPECT_EQ(read.tone_curve, gaussians::kSrgb);
  EXPECT_DOUBLE_EQ(read.vignetting.square, 0.25);
  EXPECT_DOUBLE_EQ(read.vignetting.fourth, -0.03);
  write_map(file, {.gaussians = random_map(2, 0)});
  EXPECT_TRUE(read_map(file).vignetting.is_none());
}

TEST(Ply, DropsInvalidGaussians) {
  const TmpDir dir;
  gaussians::Gaussians map = random_map(4, 1);
  map.means[0][1] = std::numeric_limits<float>::quiet_NaN();
  map.logit_opacities[1] = std::numeric_limits<float>::quiet_NaN();
  map.quaternions[3].zero_();
  write_ply(dir.path() / "map.ply", map);
  const gaussians::Gaussians read = read_ply(dir.path() / "map.ply");
  ASSERT_EQ(read.size(), 1);
  EXPECT_TRUE(torch::equal(read.means[0], map.means[2]));
  EXPECT_TRUE(torch::equal(read.sh_rest[0], map.sh_rest[2]));
}

TEST(Ply, InfiniteOpacityIsOpaqueOrTransparent) {
  const TmpDir dir;
  gaussians::Gaussians map = random_map(3, 0);
  map.logit_opacities[0] = std::numeric_limits<float>::infinity();
  map.logit_opacities[1] = -std::numeric_limits<float>::infinity();
  write_ply(dir.path() / "map.ply", map);
  const gaussians::Gaussians read = read_ply(dir.path() / "map.ply");
  ASSERT_EQ(read.size(), 3);
  const torch::Tensor opacity = torch::sigmoid(read.logit_opacities);
  EXPECT_TRUE(torch::isfinite(read.logit_opacities).all().item<bool>());
  EXPECT_GT(opacity[0].item<float>(), 0.99999F);
  EXPECT_LT(opacity[1].item<float>(), 1e-5F);
  EXPECT_EQ(read.logit_opacities[2].item<float>(), map.logit_opacities[2].item<float>());
}

std::string row_of(std::size_t count) {
  std::string row;
  for (std::size_t i = 0; i < count; ++i) row += std::to_string(i + 1) + " ";
  return row + "\n";
}

TEST(Ply, FlatGaussiansGetThinThirdAxis) {
  const TmpDir dir;
  std::vector<std::string> names = required_properties();
  names.erase(std::remove(names.begin(), names.end(), "scale_2"), names.end());
  const gaussians::Gaussians map =
      read_ply(dir.write("map.ply", header("ascii", "1", names) + row_of(names.size())));
  ASSERT_EQ(map.size(), 1);
  EXPECT_EQ(map.log_scales[0][1].item<float>(), 9.0F);
  EXPECT_LT(map.log_scales[0][2].item<float>(), -10.0F);
}

TEST(Ply, ColorsOfBytesReplaceConstantCoefficients) {
  const TmpDir dir;
  std::vector<std::string> names = {"x",       "y",     "z",     "opacity", "scale_0", "scale_1",
                                    "scale_2", "rot_0", "rot_1", "rot_2",   "rot_3"};
  std::string text = header("ascii", "1", names);
  text.insert(text.find("end_header"),
              "property uchar red\nproperty uchar green\nproperty uchar blue\n");
  const gaussians::Gaussians map =
      read_ply(dir.write("map.ply", text + "0 0 0 0 0 0 0 1 0 0 0 255 0 51\n"));
  EXPECT_TRUE(tensors_near(gaussians::sh_dc_to_color(map.sh_dc),
                           torch::tensor({{1.0F, 0.0F, 0.2F}}), 1e-6));
}

TEST(Ply, DropsCoefficientsAboveDegreeThree) {
  const TmpDir dir;
  std::vector<std::string> names = required_properties();
  for (int i = 0; i < 72; ++i) names.push_back("f_rest_" + std::to_string(i));
  const gaussians::Gaussians map =
      read_ply(dir.write("map.ply", header("ascii", "1", names) + row_of(names.size())));
  ASSERT_EQ(map.sh_rest.sizes(), at::IntArrayRef({1, 15, 3}));
  EXPECT_EQ(map.sh_rest[0][0][0].item<float>(), 15.0F);           // f_rest_0
  EXPECT_EQ(map.sh_rest[0][14][0].item<float>(), 15.0F + 14.0F);  // f_rest_14
  EXPECT_EQ(map.sh_rest[0][0][1].item<float>(), 15.0F + 24.0F);   // f_rest_24
  EXPECT_EQ(map.sh_rest[0][14][2].item<float>(), 15.0F + 62.0F);  // f_rest_62
}

TEST(Ply, SkipsElementsBeforeAndAfterTheVertices) {
  const TmpDir dir;
  for (const std::string format : {"ascii", "binary_little_endian"}) {
    std::string text = header(format, "1", required_properties());
    text.insert(text.find("element vertex"),
                "element camera 2\nproperty float fx\nproperty short n\n");
    text.insert(text.find("end_header"), "element face 1\nproperty list uchar int indices\n");
    if (format == "ascii") {
      text += "1.5 2\n1.5 2\n" + row_of(14) + "3 0 0 0\n";
    } else {
      text.append(12, '\7');
      for (int i = 0; i < 14; ++i) {
        const float value = static_cast<float>(i + 1);
        text.append(reinterpret_cast<const char*>(&value), 4);
      }
      text.append(13, '\0');
    }
    const gaussians::Gaussians map = read_ply(dir.write("map.ply", text));
    ASSERT_EQ(map.size(), 1) << format;
    EXPECT_EQ(map.means[0][0].item<float>(), 1.0F) << format;
    EXPECT_EQ(map.quaternions[0][3].item<float>(), 14.0F) << format;
  }
}

TEST(Ply, ReadsHeaderWithCarriageReturns) {
  const TmpDir dir;
  std::string text;
  for (const char c : header("ascii", "1", required_properties())) {
    text += c == '\n' ? std::string("\r\n") : std::string(1, c);
  }
  EXPECT_EQ(read_ply(dir.write("map.ply", text + row_of(14))).size(), 1);
}

TEST(Ply, ErrorNamesPointCloudsAndMeshes) {
  const TmpDir dir;
  const std::string cloud = header("ascii", "1", {"x", "y", "z"});
  EXPECT_THAT(error_of(dir.write("m.ply", cloud + "1 2 3\n")),
              HasSubstr("m.ply:7: points, not a map of Gaussians: the vertices have no property "
                        "opacity, scale_0"));
  std::string mesh = cloud;
  mesh.insert(mesh.find("end_header"), "element face 1\nproperty list uchar int vertex_indices\n");
  EXPECT_THAT(error_of(dir.write("m.ply", mesh + "1 2 3\n3 0 0 0\n")),
              HasSubstr("a mesh, not a map of Gaussians"));
}

TEST(Ply, PointsAreRelativeToOrigin) {
  const TmpDir dir;
  const std::string text = header("ascii", "1", {"x", "y", "z"}, "double");
  const gaussians::PointCloud far = read_ply_points(
      dir.write("m.ply", text + "596000.125 6640000.25 -3.5\n"), {596000.0, 6640000.0, 0.0});
  EXPECT_TRUE(torch::equal(far.positions, torch::tensor({{0.125F, 0.25F, -3.5F}})));
  const gaussians::Gaussians map = random_map(3, 0);
  write_ply(dir.path() / "map.ply", map, std::nullopt, {100.0, 200.0, 0.0});
  const gaussians::PointCloud moved = read_ply_points(dir.path() / "map.ply", {100.0, 150.0, 0.0});
  EXPECT_TRUE(tensors_near(moved.positions, map.means + torch::tensor({0.0F, 50.0F, 0.0F}), 1e-5));
}

TEST(Ply, RoundTripsEmptyMap) {
  const TmpDir dir;
  write_ply(dir.path() / "map.ply", random_map(0, 3));
  const gaussians::Gaussians map = read_ply(dir.path() / "map.ply");
  EXPECT_EQ(map.size(), 0);
  EXPECT_EQ(map.sh_rest.sizes(), at::IntArrayRef({0, 15, 3}));
}

TEST(Ply, ChecksVertexCountAgainstFileSize) {
  const TmpDir dir;
  const auto file = [&](const std::string& format, const std::string& count) {
    return dir.write("map.ply", header(format, count, required_properties()) + "0 0 0");
  };
  EXPECT_THAT(error_of(file("binary_little_endian", "1000000000000")),
              HasSubstr("the header states 1000000000000 rows of element vertex"));
  EXPECT_THAT(error_of(file("ascii", "1000000000000")), HasSubstr("truncated"));
  EXPECT_THAT(error_of(file("ascii", "99999999999999999999")), HasSubstr("map.ply:3: invalid"));
  EXPECT_THAT(error_of(file("ascii", "-1")),
              HasSubstr("map.ply:3: invalid count of element vertex"));
}

TEST(Ply, ErrorNamesMissingProperty) {
  const TmpDir dir;
  for (const std::string missing : {"y", "opacity", "rot_3", "scale_0"}) {
    std::vector<std::string> names = required_properties();
    names.erase(std::remove(names.begin(), names.end(), missing), names.end());
    const fs::path file = dir.write("map.ply", header("ascii", "0", names));
    EXPECT_THAT(error_of(file), HasSubstr("the vertices have no property " + missing));
  }
  std::vector<std::string> names = required_properties();
  for (int i = 0; i < 7; ++i) names.push_back("f_rest_" + std::to_string(i));
  EXPECT_THAT(error_of(dir.write("map.ply", header("ascii", "0", names))),
              HasSubstr("7 properties f_rest_*: 0, 9, 24 or 45"));
}

TEST(Ply, RejectsInvalidHeaderWithLineNumber) {
  const TmpDir dir;
  const auto error = [&](const std::string& text) { return error_of(dir.write("m.ply", text)); };
  EXPECT_THAT(error("hello\n"), HasSubstr("m.ply:1: the first line is not \"ply\""));
  EXPECT_THAT(error(""), HasSubstr("m.ply:1: the file ends within the header"));
  EXPECT_THAT(error("ply\nformat ascii 1.0\n"), HasSubstr("m.ply:3: the file ends within"));
  EXPECT_THAT(error("ply\nformat tiny 1.0\n"), HasSubstr("m.ply:2: the format must be"));
  EXPECT_THAT(error("ply\nelement vertex 1\nproperty half x\n"), HasSubstr("type \"half\""));
  EXPECT_THAT(error("ply\nelement vertex 1\nproperty list uchar int x\n"),
              HasSubstr("list properties"));
  EXPECT_THAT(error("ply\nformat ascii 1.0\nelement face 1\nproperty int x\nend_header\n1\n"),
              HasSubstr("m.ply:5: the header has no vertex element"));
  EXPECT_THAT(error("ply\nproperty float x\n"), HasSubstr("m.ply:2: a property must follow"));
  EXPECT_THAT(error("ply\n" + std::string(1 << 20, 'x')), HasSubstr("m.ply:2: this line is too"));
  EXPECT_THAT(error("ply\nend_header\n"), HasSubstr("no format line"));
  EXPECT_THAT(error_of(dir.path() / "missing.ply"), HasSubstr("does the file exist?"));
  EXPECT_THAT(error_of(dir.path()), HasSubstr("this is a folder"));
}

TEST(Ply, RejectsNonNumericTextWithVertexIndex) {
  const TmpDir dir;
  const std::string row = "1 1 1 1 1 1 1 1 1 1 1 1 1 1\n";
  const fs::path file = dir.write(
      "m.ply", header("ascii", "2", required_properties()) + row + "1 1 1 1 x 1 1 1 1 1 1 1 1 1\n");
  EXPECT_THAT(error_of(file), HasSubstr("vertex 1: \"x\" is not a number"));
}

TEST(Ply, ReadsPointsFromCloudsAndMaps) {
  const TmpDir dir;
  const fs::path cloud = dir.write(
      "cloud.ply",
      "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float "
      "z\nproperty uchar red\nproperty uchar green\nproperty uchar blue\nend_header\n1 2 3 255 0 "
      "51\n");
  const gaussians::PointCloud points = read_ply_points(cloud);
  EXPECT_TRUE(tensors_near(points.positions, torch::tensor({{1.0F, 2.0F, 3.0F}}), 0.0));
  EXPECT_TRUE(tensors_near(points.colors, torch::tensor({{1.0F, 0.0F, 0.2F}}), 1e-6));
  gaussians::Gaussians map = random_map(3, 0);
  map.sh_dc = gaussians::color_to_sh_dc(torch::full({3, 3}, 0.25F));
  write_ply(dir.path() / "map.ply", map);
  const gaussians::PointCloud centers = read_ply_points(dir.path() / "map.ply");
  EXPECT_TRUE(torch::equal(centers.positions, map.means));
  EXPECT_TRUE(tensors_near(centers.colors, torch::full({3, 3}, 0.25F), 1e-6));
}

TEST(Ply, TabsSeparateTheWordsOfTheHeader) {
  const TmpDir dir;
  const fs::path cloud =
      dir.write("cloud.ply",
                "ply\nformat\tascii\t1.0\nelement\tvertex 1\nproperty\tfloat\tx\n"
                "property float y\nproperty float z\nend_header\n1\t2\t3\n");
  EXPECT_TRUE(
      tensors_near(read_ply_points(cloud).positions, torch::tensor({{1.0F, 2.0F, 3.0F}}), 0.0));
}

TEST(Ply, ReadsTheGardenMap) {
  APVI_NEEDS_DATA(file, "splat_reference/garden.ply");
  const gaussians::Gaussians map = read_ply(file);
  EXPECT_EQ(map.size(), 111785);
  EXPECT_EQ(map.sh_rest.size(1), 0);
  EXPECT_LT(map.log_scales.mean().item<float>(), 0.0F);
}

}  // namespace
}  // namespace apvi::map_io
