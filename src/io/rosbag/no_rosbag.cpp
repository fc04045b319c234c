// SPDX-License-Identifier: BSD-3-Clause
#include "apvi/core/error.hpp"
#include "io/readers.hpp"
#include "io/rosbag/bag_writer.hpp"

// What a build without rosbag_storage has instead: errors that say so.
namespace apvi::io {

struct BagWriter::Impl {};

Recording open_bag(const std::filesystem::path& path, const DatasetConfig&, const SensorChoice&) {
  fail_input("{}: built without rosbag support (APVI_WITH_ROSBAG=OFF)", path.string());
}

BagWriter::BagWriter(const std::filesystem::path& path) {
  fail_run("{}: built without rosbag support (APVI_WITH_ROSBAG=OFF)", path.string());
}
// The constructor throws, so none of these is ever called.
BagWriter::~BagWriter() = default;
void BagWriter::set_record_delay(Duration) {}
void BagWriter::write_imu(const std::string&, const ImuSample&) {}
void BagWriter::write_pressure(const std::string&, const PressureSample&) {}
void BagWriter::write_depth(const std::string&, const PressureDepthSample&, double) {}
void BagWriter::write_dvl(const std::string&, const DvlSample&) {}
void BagWriter::write_pose(const std::string&, const StampedPose&) {}
void BagWriter::write_image(const std::string&, Stamp, const std::string&,
                            const std::vector<std::uint8_t>&) {}
void BagWriter::write_raw(const std::string&, Stamp, const std::string&, const std::string&,
                          const std::string&, const std::vector<std::uint8_t>&) {}
void BagWriter::close() {}

}  // namespace apvi::io
