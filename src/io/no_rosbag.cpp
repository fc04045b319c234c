// SPDX-License-Identifier: BSD-3-Clause
#include "apvi/core/error.hpp"
#include "apvi/io/bag_writer.hpp"
#include "io/readers.hpp"

// What stands for bags in a build without rosbag_storage.
namespace apvi::io {

struct BagWriter::Impl {};

Recording open_bag(const std::filesystem::path& path, const DatasetConfig&, const SensorChoice&) {
  fail_input("{}: this program was built without bags (APVI_WITH_ROSBAG=OFF)", path.string());
}

BagWriter::BagWriter(const std::filesystem::path& path) {
  fail_run("{}: this program was built without bags (APVI_WITH_ROSBAG=OFF)", path.string());
}
// No object exists, so none of these is ever called.
BagWriter::~BagWriter() = default;
void BagWriter::set_record_delay(Duration) {}
void BagWriter::write_imu(const std::string&, const ImuSample&) {}
void BagWriter::write_pressure(const std::string&, const PressureSample&) {}
void BagWriter::write_depth(const std::string&, const DepthSample&, double) {}
void BagWriter::write_dvl(const std::string&, const DvlSample&) {}
void BagWriter::write_pose(const std::string&, const StampedPose&) {}
void BagWriter::write_image(const std::string&, Stamp, const std::string&,
                            const std::vector<std::uint8_t>&) {}
void BagWriter::write_raw(const std::string&, Stamp, const std::string&, const std::string&,
                          const std::string&, const std::vector<std::uint8_t>&) {}
void BagWriter::close() {}

}  // namespace apvi::io
