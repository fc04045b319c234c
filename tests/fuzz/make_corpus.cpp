// SPDX-License-Identifier: BSD-3-Clause
#include <filesystem>
#include <iostream>
#include <map>
#include <sstream>
#include <string>
#include <vector>

#include "apvi/io/tum.hpp"
#include "core/text_file.hpp"
#include "importer/mp4_bytes.hpp"
#include "importer/vehicle_bytes.hpp"
#include "io/cdr_bytes.hpp"
#include "io/db3_writer.hpp"
#include "io/mcap_writer.hpp"
#include "io/ros_bytes.hpp"
#include "io/rosbag/ros_definitions.hpp"
#include "io/rosbag2/ros2_definitions.hpp"
#include "map_io/compressed_ply.hpp"
#include "map_io/spz.hpp"

// Writes seed inputs for the fuzz targets: `make_corpus FOLDER` creates FOLDER/<target>/<n>.

namespace {

using namespace apvi;
using namespace std::string_literals;
using Seeds = std::map<std::string, std::vector<std::string>>;

std::string with_message(const std::string& definition, const std::vector<std::uint8_t>& bytes) {
  return definition + '\0' + std::string(bytes.begin(), bytes.end());
}

test::RosBytes& put_zeros(test::RosBytes& bytes, int count) {
  for (int i = 0; i < count; ++i) bytes.put(0.0);
  return bytes;
}

std::vector<std::string> ros_seeds() {
  test::RosBytes imu;
  put_zeros(imu.header(1, 2), 4 + 9 + 3 + 9 + 3 + 9);
  test::RosBytes pressure;
  pressure.header(1, 2).put(101325.0).put(0.0);
  test::RosBytes odometry;
  put_zeros(odometry.header(1, 2).text("child"), 7 + 36 + 6 + 36);
  test::RosBytes image;
  image.header(1, 2).text("png").put(std::uint32_t{4}).put(std::uint32_t{0x474e5089});
  test::RosBytes dvl;
  put_zeros(dvl.header(1, 2), 6).put(std::uint32_t{1}).put(std::int64_t{0});
  put_zeros(dvl, 4).put(std::uint8_t{1}).put(std::uint8_t{1}).put(std::int64_t{0}).text("x");
  test::RosBytes raw;
  raw.header(1, 2).put(2U).put(2U).text("bayer_rggb8").put(std::uint8_t{0}).put(2U);
  raw.put(4U).put(std::uint32_t{0x01020304});
  const std::string raw_definition =
      "Header header\nuint32 height\nuint32 width\nstring encoding\nuint8 is_bigendian\n"
      "uint32 step\nuint8[] data\n" +
      test::kHeaderPart;
  return {with_message(io::imu_definition().text, imu.get()),
          with_message(io::fluid_pressure_definition().text, pressure.get()),
          with_message(io::odometry_definition().text, odometry.get()),
          with_message(io::compressed_image_definition().text, image.get()),
          with_message(io::waterlinked_dvl_definition().text, dvl.get()),
          with_message(raw_definition, raw.get()),
          with_message(io::ros2_definitions("sensor_msgs/Imu").at(0), test::cdr_imu(1, 2.0)),
          with_message(io::ros2_definitions("sensor_msgs/Imu").at(0), test::cdr_imu(1, 2.0, true)),
          with_message(io::ros2_definitions("dvl_msgs/DVL").at(0), test::cdr_dvl(1, 2.0))};
}

std::vector<std::string> mcap_seeds() {
  std::vector<std::string> seeds;
  for (const char* compression : {"", "lz4", "zstd"}) {
    for (const bool summary : {true, false}) {
      test::McapWriter writer({compression, summary || *compression != '\0', summary, false});
      const auto imu = writer.add_topic("/imu", "sensor_msgs/msg/Imu",
                                        io::ros2_definitions("sensor_msgs/Imu").at(0));
      const auto dvl =
          writer.add_topic("/dvl", "dvl_msgs/msg/DVL", io::ros2_definitions("dvl_msgs/DVL").at(0));
      writer.write(imu, 5, test::cdr_imu(5, 1.0));
      writer.end_chunk();
      writer.write(dvl, 4, test::cdr_dvl(4, 1.0));
      writer.write(imu, 6, test::cdr_imu(6, 1.0));
      seeds.push_back(writer.finish());
    }
  }
  return seeds;
}

std::vector<std::string> vehicle_log_seeds() {
  const std::string dataflash =
      test::dataflash_formats() +
      test::dataflash_imu(1'000'000, 0, {0.0F, 0.0F, 0.0F, 0.0F, 0.0F, -9.8F}) +
      test::dataflash_baro(1'000'000, 1, 2e5F) +
      test::dataflash_viso(1'000'000, 0.2F, {0.1F, 0.0F, 0.0F}, 90.0F) +
      test::dataflash_gps(1'000'000, 3, 1'500, 2312, 473'977'418, 85'455'939, 0) +
      test::dataflash_raw(134, 1'000'000, 999'000, {0.0F, 0.0F, 0.0F}) +
      test::dataflash_raw(135, 1'000'000, 999'000, {0.0F, 0.0F, -9.8F});
  const std::string telemetry =
      test::telemetry(1'700'000'000'000'000, test::raw_imu_frame(1'000'000, {0, 0, -1000})) +
      test::telemetry(1'700'000'000'000'000, test::delta_frame(0, 200'000, {0.1F, 0, 0}, 90.0F));
  return {dataflash, telemetry};
}

// With and without the definition of its messages.
std::vector<std::string> db3_seeds() {
  std::vector<std::string> seeds;
  const std::filesystem::path file = std::filesystem::temp_directory_path() / "apvi_corpus.db3";
  for (const bool defined : {true, false}) {
    std::filesystem::remove(file);
    test::Db3Writer writer(file);
    const std::string definition = io::ros2_definitions("sensor_msgs/Imu").at(0);
    const int imu = writer.add_topic("/imu", "sensor_msgs/msg/Imu", defined ? definition : "");
    const int dvl = writer.add_topic("/dvl", "dvl_msgs/msg/DVL");
    writer.write(imu, 5, test::cdr_imu(5, 1.0));
    writer.write(dvl, 6, test::cdr_dvl(6, 1.0));
    writer.close();
    seeds.push_back(read_text(file));
  }
  std::filesystem::remove(file);
  return seeds;
}

// Four by four pixels in encodings of all layouts.
std::vector<std::string> image_seeds() {
  std::vector<std::string> seeds;
  for (const auto& [encoding, step] : std::map<std::string, char>{{"mono8", 4},
                                                                  {"bgr8", 12},
                                                                  {"bayer_grbg16", 8},
                                                                  {"8UC4", 16},
                                                                  {"yuv422_yuy2", 8},
                                                                  {"nv12", 4},
                                                                  {"mono16", 0}}) {
    seeds.push_back(std::string("\4\4", 2) + step + '\0' + encoding + '\0' + std::string(64, 'x'));
  }
  return seeds;
}

Seeds importer_seeds() {
  const std::string stamp = test::stamp_us(1'000'000) + test::klv_text("ORIN", "ZXY");
  const std::string payload = test::device(
      test::sensor_stream({.key = "ACCL", .before = stamp, .samples = {{1, 2, 3}, {4, 5, 6}}}) +
      test::sensor_stream({.key = "GYRO", .before = stamp, .samples = {{1, 2, 3}, {4, 5, 6}}}) +
      test::shutter_stream(stamp, {0.01F}));
  const std::string moov = test::mvhd() + test::trak({.sizes = {8, 9}, .chunk_offsets = {0, 8}}) +
                           test::trak({.handler = "vide",
                                       .format = "avc1",
                                       .sizes = {8, 9},
                                       .chunk_offsets = {0, 8},
                                       .composition_offsets = {1, 2},
                                       .edits = test::u32(5) + test::u32(0xFFFFFFFF) + test::u32(0),
                                       .edit_count = 1});
  const std::string jpeg = "\xFF\xD8\xFF\xC0"s + test::i16(11) + '\x08' + test::i16(4) +
                           test::i16(6) + std::string(4, '\0');
  return {{"fuzz_mp4", {moov}},
          {"fuzz_gpmf", {payload, test::klv_text("VFOV", "W")}},
          {"fuzz_photo", {jpeg}},
          {"fuzz_vehicle_log", vehicle_log_seeds()},
          {"fuzz_metashape",
           {"<document><chunk><sensors><sensor id=\"0\"><resolution width=\"32\" height=\"24\"/>"
            "<calibration type=\"frame\"><f>40</f><cx>1</cx><k1>-0.1</k1><p1>0.01</p1>"
            "</calibration></sensor></sensors><cameras><camera sensor_id=\"0\" label=\"a\">"
            "<transform>1 0 0 1 0 1 0 2 0 0 1 3 0 0 0 1</transform></camera></cameras>"
            "<transform><scale>0.5</scale></transform></chunk></document>"}},
          {"fuzz_colmap",
           {"1 OPENCV 32 24 20 21 16 12 0.1 -0.01 0.002 0.003\n",
            "1 1 0 0 0 0 0 0 1 a.png\n1 2 -1\n", "1 0.5 0.25 2 10 20 30 0.7\n"}}};
}

map_io::Splats few_splats(std::size_t coefficients) {
  map_io::Splats splats(3, coefficients);
  for (std::size_t i = 0; i < splats.means.size(); ++i) splats.means[i] = static_cast<float>(i);
  for (std::size_t i = 0; i < splats.count; ++i) splats.quaternions[4 * i + i] = 1.0F;
  return splats;
}

std::vector<std::string> ply_seeds() {
  const std::string vertices =
      "element vertex 2\nproperty float x\nproperty double y\nproperty uchar red\nend_header\n";
  const std::string camera = "element camera 1\nproperty short n\n";
  std::ostringstream compressed;
  map_io::write_compressed_ply(compressed, few_splats(3), "comment a\n");
  return {"ply\nformat ascii 1.0\n" + camera + vertices + "7\n1 2 3\n4 nan 6\n",
          "ply\nformat binary_little_endian 1.0\n" + camera + vertices + std::string(28, '\1'),
          "ply\nformat binary_big_endian 1.0\n" + vertices + std::string(26, '\1'),
          compressed.str()};
}

// The fuzz target also compresses its input, so one seed is that of an uncompressed header.
std::vector<std::string> spz_seeds() {
  std::ostringstream file;
  map_io::write_spz(file, {few_splats(8), true});
  std::string plain = "NGSP\3\0\0\0\1\0\0\0\1\14\0\0"s;
  return {file.str(), plain + std::string(29, 'a'), "NGSP\2\0\0\0\0\0\0\0\0\14\0\0"s};
}

// The log of a DVL is the seventh file of a data set.
std::string with_dvl_log(const std::string& imu) {
  return imu + "\0\0\0\0\0\0"s +
         R"({"vx":0.1,"vy":0,"vz":-1e-3,"fom":0.01,"altitude":-1,"velocity_valid":true,)"
         R"("type":"velocity","time_of_validity":1000000,)"
         R"("transducers":[{"id":0,"velocity":1,"distance":2,"beam_valid":true}]})"
         "\n{\"type\":\"position_local\",\"ts\":1.5}\n";
}

// A SCALED_IMU2 and a SCALED_PRESSURE of version 1, as pymavlink writes them.
std::string mavlink_seed() {
  return "\xfd\x15\0\0\0\x01\x01\x74\0\0\xe1\x10\0\0\x01\0\x02\0\x03\0\x04\0\x05\0\x06\0\x07\0\x08"
         "\0\x09"
         "\x66\xa0\xfe\x0e\0\x01\x01\x1d\xdc\x05\0\0\0\x50\x7d\x44\0\0\0\0\xd2\x04\xd3\x46"s;
}

Seeds all_seeds() {
  const std::string imu =
      "#timestamp [ns],w_x,w_y,w_z,a_x,a_y,a_z\n1000000000,0,0,0,0,0,9.8\n1010000000,0,0,0,0,0,9\n"
      "99999000000000,0,0,0,0,0,9\n1020000000,nan,0,0,0,0,9\n1030000000,1,2,3,4,5,6\n";
  const std::string dvl =
      "#timestamp [ns],v_x,v_y,v_z,figure_of_merit,altitude,valid,beam0_v,beam0_range,beam0_valid\n"
      "1000000000,1,2,3,0.01,,1,0.5,3,1\n1200000000,,,,,,0,,,\n";
  const std::string yaml =
      "world: ned\nimu0: {rate_hz: 100}\ncam0:\n  intrinsics: [400, 400, 320, 240]\n"
      "  resolution: [640, 480]\n  distortion: radtan\n  coefficients: [0.1, 0, 0, 0]\n"
      "  T_body_sensor: [1,0,0,0, 0,1,0,0, 0,0,1,0, 0,0,0,1]\ndvl0: {sound_speed: 1480}\n";
  const std::string sensor =
      "%YAML:1.0\nT_BS: !!opencv-matrix\n  rows: 4\n  cols: 4\n"
      "  data: [1,0,0,0, 0,1,0,0, 0,0,1,0, 0,0,0,1]\nrate_hz: 20\n";
  return {
      {"fuzz_dataset",
       {imu, imu + "\0"s + dvl, with_dvl_log(imu),
        imu + "\0"s + dvl + "\0#timestamp [ns],pressure [hPa]\n1,1013\n"s +
            "\0#timestamp [ns],depth [m]\n1,2\n"s +
            "\0#timestamp [ns],east,north,up\n1,2,3,4\n\0#timestamp [ns],filename\n1,a.png\n"s}},
      {"fuzz_config",
       {yaml, "path: a\nformat: folder\nstart_s: 2\nblackout_s: [[1, 2]]\n"s,
        yaml + "\0imu0.rate_hz=3"s, "a: &a [1]\nb: *a\n"s}},
      {"fuzz_trajectory",
       {"# t\n1.5 1 2 3 0 0 0 1\n1.6 1 2 3 0 0 1 0\n",
        "#timestamp [ns],p_x [m],p_y [m],p_z [m],q_w,q_x,q_y,q_z\n1,1,2,3,1,0,0,0\n",
        "#timestamp [ns],east [m],north [m],up [m]\n1,2,3,0\n", "1,1,2,3,1,0,0,0\n"}},
      {"fuzz_db3", db3_seeds()},
      {"fuzz_mavlink", {mavlink_seed()}},
      {"fuzz_mcap", mcap_seeds()},
      {"fuzz_ply", ply_seeds()},
      {"fuzz_raw_image", image_seeds()},
      {"fuzz_ros_message", ros_seeds()},
      {"fuzz_sensor_yaml",
       {sensor + "\0"s + sensor +
        "camera_model: pinhole\nintrinsics: [1, 1, 1, 1]\n"
        "resolution: [2, 2]\ndistortion_model: radial-tangential\n"
        "distortion_coefficients: [0, 0, 0, 0]\n"}},
      {"fuzz_spz", spz_seeds()},
      {"fuzz_waterlinked", {with_dvl_log("")}}};
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 2) {
    std::cerr << "usage: make_corpus FOLDER\n";
    return 2;
  }
  Seeds all = all_seeds();
  all.merge(importer_seeds());
  for (const auto& [target, seeds] : all) {
    const std::filesystem::path folder = std::filesystem::path(argv[1]) / target;
    std::filesystem::create_directories(folder);
    for (std::size_t i = 0; i < seeds.size(); ++i) {
      io::write_text_file(folder / ("seed" + std::to_string(i)), seeds[i]);
    }
  }
  return 0;
}
