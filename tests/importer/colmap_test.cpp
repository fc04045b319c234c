// SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <bit>
#include <sstream>

#include "apvi/io/sequence.hpp"
#include "apvi/sensors/rig.hpp"
#include "importer/colmap_model.hpp"
#include "importer/import.hpp"
#include "importer/source_files.hpp"
#include "io/dataset_builder.hpp"

namespace apvi::importer {
namespace {

using test::as_bytes;
using test::big;
using test::config_for;
using test::input_error;
using test::read_dataset;
using test::read_file;
using test::TmpDir;
using test::write_photo;
using testing::HasSubstr;
namespace fs = std::filesystem;

template <typename T>
std::string little(T value) {
  std::string text = big(value);
  return {text.rbegin(), text.rend()};
}
std::string f64(double value) {
  return little(std::bit_cast<std::uint64_t>(value));
}

constexpr const char* kCameras =
    "# Camera list\n1 OPENCV 32 24 20 21 16 12 0.1 -0.01 0.002 0.003\n";
// The camera of the second image stands at (1, 2, 3), turned by 180 degrees around z.
constexpr const char* kImages =
    "# Image list\n2 0 0 0 1 1 2 -3 1 b 10.png\n1.5 2.5 -1\n1 1 0 0 0 0 0 0 1 b 9.png\n\n";
constexpr const char* kPoints = "1 0.5 0.25 2 10 20 30 0.7 1 0\n";

class ColmapTest : public testing::Test {
 protected:
  void write_model() {
    dir_.write("model/sparse/0/cameras.txt", kCameras);
    dir_.write("model/sparse/0/images.txt", kImages);
    dir_.write("model/sparse/0/points3D.txt", kPoints);
    write_photo(dir_, "model/images/b 9.png", 90);
    write_photo(dir_, "model/images/b 10.png", 100);
  }
  fs::path model() const { return dir_.path() / "model"; }
  fs::path out() const { return dir_.path() / "dive"; }
  TmpDir dir_;
};

TEST_F(ColmapTest, BecomesGivenPosesCalibrationAndPoints) {
  write_model();
  EXPECT_EQ(source_kind(model()), SourceKind::colmap);
  ImportOptions options;
  options.meters_per_unit = 2.0;
  const ImportResult result = import_source(model(), out(), options);
  EXPECT_EQ(result.poses, 2U);
  EXPECT_EQ(result.points, 1U);
  const auto reference = io::open_sequence(config_for(out()), {"camera"})->reference();
  ASSERT_TRUE(reference);
  ASSERT_EQ(reference->size(), 2U);
  const SE3& second = reference->poses[1].T_world_body;
  EXPECT_LT((second.translation - Eigen::Vector3d(2, 4, 6)).norm(), 1e-6);
  EXPECT_NEAR(std::abs(second.rotation.z()), 1.0, 1e-9);
  const auto p = make_rig(config::load_file(out() / "rig.yaml")).cameras[0].model.parameters();
  EXPECT_EQ(p.fy, 21.0);
  EXPECT_EQ(p.cx, 15.5);
  EXPECT_EQ(p.coefficients[3], 0.003);
  EXPECT_THAT(read_file(out() / "points3D.txt"), HasSubstr("1 1 0.5 4 10 20 30 0"));
  EXPECT_THAT(read_file(out() / "import.yaml"), HasSubstr("scale: known"));
}

TEST_F(ColmapTest, ImagesAreCopiedInNaturalOrderWithTheStampsOfTheirPoses) {
  write_model();
  import_source(model(), out(), {});
  const auto events = read_dataset(config_for(out()), {"camera"}).events;
  const auto reference = io::open_sequence(config_for(out()), {"camera"})->reference();
  ASSERT_EQ(events.size(), 2U);
  EXPECT_EQ(cv::mean(std::get<ImageFrame>(events[0]).decode())[0], 90.0);
  EXPECT_EQ(stamp_of(events[1]), reference->poses[1].stamp);
  EXPECT_THAT(read_file(out() / "import.yaml"), HasSubstr("scale: unknown"));
}

TEST_F(ColmapTest, MasksGoWithTheirImages) {
  write_model();
  ImportOptions options;
  options.mask_folder = dir_.path() / "masks";
  options.images.scale = 0.5;
  EXPECT_THAT(input_error([&] { import_source(model(), out(), options); }),
              HasSubstr("no mask of any image"));
  cv::Mat mask(24, 32, CV_8U, cv::Scalar(255));
  mask.rowRange(10, 24).setTo(0);
  cv::imwrite(dir_.write("masks/b 10.png.png", "").string(), mask);
  import_source(model(), out(), options);
  const auto events = read_dataset(config_for(out()), {"camera"}).events;
  ASSERT_EQ(events.size(), 2U);
  EXPECT_FALSE(std::get<ImageFrame>(events[0]).mask);
  const auto& second = std::get<ImageFrame>(events[1]);
  ASSERT_TRUE(second.mask);
  EXPECT_EQ(second.mask().size(), cv::Size(16, 12));
  EXPECT_EQ(cv::countNonZero(second.mask()), 16 * 5);
}

TEST_F(ColmapTest, ErrorsNameWhatIsMissing) {
  write_model();
  const auto error = [&](const ImportOptions& options = {}) {
    return input_error([&] { import_source(model(), out(), options); });
  };
  ImportOptions elsewhere;
  elsewhere.image_folder = dir_.path();
  EXPECT_THAT(error(elsewhere), HasSubstr("no b 9.png in it"));
  write_photo(dir_, "model/images/b 9.png", 90, {16, 12});
  EXPECT_THAT(error(), HasSubstr("is 16 x 12, but its COLMAP camera 32 x 24"));
  fs::remove_all(model() / "images");
  EXPECT_THAT(error(), HasSubstr("name their folder with --images"));
  EXPECT_FALSE(fs::exists(out()));
}

TEST_F(ColmapTest, ImagesMayBeInSubfolders) {
  dir_.write("model/sparse/0/cameras.txt", kCameras);
  dir_.write("model/sparse/0/images.txt",
             "1 1 0 0 0 0 0 0 1 left/1700000000000000000.png\n\n"
             "2 1 0 0 0 0 0 0 1 left/1700000000500000000.png\n\n");
  for (const char* name : {"1700000000000000000", "1700000000500000000"}) {
    write_photo(dir_, fmt::format("model/images/left/{}.png", name));
  }
  EXPECT_EQ(import_source(model(), out(), {}).images, 2U);
  const auto events = read_dataset(config_for(out()), {"camera"}).events;
  ASSERT_EQ(events.size(), 2U);
  EXPECT_EQ(stamp_of(events[1]).ns, 1'700'000'000'500'000'000);
  EXPECT_NEAR(make_rig(config::load_file(out() / "rig.yaml")).cameras[0].rate_hz, 2.0, 1e-6);
}

TEST(ColmapBinary, HasTheContentOfText) {
  const std::string camera = little(std::uint64_t{1}) + little(7U) + little(2U) +
                             little(std::uint64_t{32}) + little(std::uint64_t{24}) + f64(20) +
                             f64(16) + f64(12) + f64(0.1);
  const auto cameras = parse_cameras_bin(as_bytes(camera), "cameras.bin");
  EXPECT_EQ(cameras.at(7).model, "SIMPLE_RADIAL");
  EXPECT_EQ(cameras.at(7).parameters[3], 0.1);
  std::string image = little(std::uint64_t{1}) + little(1U);
  for (const double number : {1.0, 0.0, 0.0, 0.0, 4.0, 5.0, 6.0}) image += f64(number);
  image += little(7U) + "cam0/1.png" + '\0' + little(std::uint64_t{2}) + std::string(48, 'x');
  const auto images = parse_images_bin(as_bytes(image), "images.bin");
  ASSERT_EQ(images.size(), 1U);
  EXPECT_EQ(images[0].name, "cam0/1.png");
  EXPECT_EQ(images[0].T_camera_world.translation, Eigen::Vector3d(4, 5, 6));
  const std::string point = little(std::uint64_t{1}) + little(std::uint64_t{3}) + f64(1) + f64(2) +
                            f64(3) + "\x0A\x14\x1E" + f64(0.5) + little(std::uint64_t{1}) +
                            std::string(8, 'x');
  const auto points = parse_points_bin(as_bytes(point), "points3D.bin");
  ASSERT_EQ(points.size(), 1U);
  EXPECT_EQ(points[0].position, Eigen::Vector3d(1, 2, 3));
  EXPECT_EQ(points[0].color, (std::array<int, 3>{10, 20, 30}));
  image.resize(image.size() - 1);
  EXPECT_THAT(input_error([&] { parse_images_bin(as_bytes(image), "images.bin"); }),
              HasSubstr("images.bin: ends early"));
}

TEST(ColmapText, ErrorsNameTheLine) {
  std::istringstream images("# header\n1 1 0 0 zero 0 0 0 1 a.png\n\n");
  EXPECT_THAT(input_error([&] { parse_images_txt(images, "images.txt"); }),
              HasSubstr("images.txt:2: \"zero\" is not a number"));
  std::istringstream bad("1 3 0 0 0 0 0 0 1 a.png\n\n");
  EXPECT_THAT(input_error([&] { parse_images_txt(bad, "images.txt"); }), HasSubstr("of norm 1"));
}

TEST(ColmapCamera, ModelsAreConverted) {
  const auto convert = [](const std::string& model, const std::vector<double>& parameters) {
    return to_camera({model, 32, 24, parameters}, "cameras.txt");
  };
  const auto radial = convert("RADIAL", {20, 16, 12, 0.1, 0.2});
  EXPECT_EQ(radial.fy, 20.0);
  EXPECT_EQ(radial.distortion, Distortion::radtan);
  EXPECT_EQ(radial.coefficients[1], 0.2);
  EXPECT_EQ(radial.coefficients[2], 0.0);
  EXPECT_EQ(convert("SIMPLE_PINHOLE", {20, 16, 12}).distortion, Distortion::none);
  EXPECT_EQ(convert("PINHOLE", {20, 21, 16, 12}).fy, 21.0);
  EXPECT_EQ(convert("OPENCV_FISHEYE", {20, 21, 16, 12, 1, 2, 3, 4}).coefficients[3], 4.0);
  const auto full = convert("FULL_OPENCV", {20, 21, 16, 12, 1, 2, 3, 4, 0, 0, 0, 0});
  EXPECT_EQ(full.distortion, Distortion::radtan);
  EXPECT_EQ(full.coefficients, (CameraModel::Coefficients{1, 2, 3, 4}));
  const auto rational = convert("FULL_OPENCV", {20, 21, 16, 12, 1, 2, 3, 4, 5, 6, 7, 8});
  EXPECT_EQ(rational.coefficients, (CameraModel::Coefficients{1, 2, 3, 4, 5, 6, 7, 8}));
  EXPECT_THAT(input_error([&] {
                convert("FOV", {20, 21, 16, 12, 1});
              }),
              HasSubstr("camera model FOV is not supported"));
  EXPECT_THAT(input_error([&] { convert("RADIAL", {20, 16}); }), HasSubstr("has 5 parameters"));
}

}  // namespace
}  // namespace apvi::importer
