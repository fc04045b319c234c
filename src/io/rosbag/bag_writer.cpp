// SPDX-License-Identifier: BSD-3-Clause
#include "io/rosbag/bag_writer.hpp"

#include <cstring>
#include <span>

#include "apvi/core/error.hpp"
#include "apvi/core/log.hpp"
#include "io/rosbag/ros_definitions.hpp"
#include "io/rosbag/rosbag_access.hpp"

namespace apvi::io {
namespace {

ros::Time to_ros(Stamp stamp) {
  // rosbag rejects time zero and cannot represent negative times.
  const std::int64_t ns = std::max<std::int64_t>(stamp.ns, 1);
  return {static_cast<std::uint32_t>(ns / 1'000'000'000),
          static_cast<std::uint32_t>(ns % 1'000'000'000)};
}

// Serializes one message, field by field.
class Bytes {
 public:
  template <typename T>
  Bytes& put(T value) {
    const auto* begin = reinterpret_cast<const std::uint8_t*>(&value);
    bytes_.insert(bytes_.end(), begin, begin + sizeof(T));
    return *this;
  }
  Bytes& put_text(const std::string& text) {
    return put_block({reinterpret_cast<const std::uint8_t*>(text.data()), text.size()});
  }
  Bytes& put_block(std::span<const std::uint8_t> block) {
    put(static_cast<std::uint32_t>(block.size()));
    bytes_.insert(bytes_.end(), block.begin(), block.end());
    return *this;
  }
  Bytes& put_vector(const Eigen::Vector3d& v) { return put(v.x()).put(v.y()).put(v.z()); }
  Bytes& put_quaternion(const Eigen::Quaterniond& q) { return put_vector(q.vec()).put(q.w()); }
  Bytes& put_zeros(std::size_t count) {
    for (std::size_t i = 0; i < count; ++i) put(0.0);
    return *this;
  }
  Bytes& put_header(Stamp stamp) {
    const ros::Time time = to_ros(stamp);
    return put(std::uint32_t{0}).put(time.sec).put(time.nsec).put_text("");
  }
  const std::vector<std::uint8_t>& get() const { return bytes_; }

 private:
  std::vector<std::uint8_t> bytes_;
};

Bytes odometry(Stamp stamp, const SE3& pose, double variance_z) {
  Bytes bytes;
  bytes.put_header(stamp).put_text("").put_vector(pose.translation).put_quaternion(pose.rotation);
  bytes.put_zeros(14).put(variance_z).put_zeros(21);  // row-major: z is the third row and column
  return bytes.put_zeros(6 + 36);
}

}  // namespace

struct BagWriter::Impl {
  std::string path;
  Duration delay;
  rosbag::Bag bag;

  void write(const std::string& topic, Stamp stamp, const RosDefinition& definition,
             const std::vector<std::uint8_t>& bytes) {
    try {
      bag.write(topic, to_ros(stamp + delay), RawMessage{&definition, bytes});
    } catch (const std::exception& e) {
      fail_run("{}: cannot write this bag: {}", path, e.what());
    }
  }
};

BagWriter::BagWriter(const std::filesystem::path& path) : impl_(std::make_unique<Impl>()) {
  impl_->path = path.string();
  try {
    impl_->bag.open(path.string(), rosbag::bagmode::Write);
  } catch (const std::exception& e) {
    fail_run("{}: cannot write this bag: {}", path.string(), explain(e));
  }
}

BagWriter::~BagWriter() {
  try {
    close();
  } catch (const std::exception& e) {
    log::error("{}", e.what());
  }
}

void BagWriter::set_record_delay(Duration delay) {
  impl_->delay = delay;
}

void BagWriter::write_imu(const std::string& topic, const ImuSample& sample) {
  Bytes bytes;
  bytes.put_header(sample.stamp).put_quaternion(Eigen::Quaterniond::Identity());
  bytes.put(-1.0).put_zeros(8);  // covariance -1: no orientation
  bytes.put_vector(sample.gyro).put_zeros(9).put_vector(sample.accel).put_zeros(9);
  impl_->write(topic, sample.stamp, imu_definition(), bytes.get());
}

void BagWriter::write_pressure(const std::string& topic, const PressureSample& sample) {
  Bytes bytes;
  bytes.put_header(sample.stamp).put(sample.pressure_pa).put(0.0);
  impl_->write(topic, sample.stamp, fluid_pressure_definition(), bytes.get());
}

void BagWriter::write_depth(const std::string& topic, const PressureDepthSample& sample,
                            double sigma_m) {
  const SE3 pose{Eigen::Quaterniond::Identity(), {0.0, 0.0, -sample.depth_m}};
  const Bytes bytes = odometry(sample.stamp, pose, sigma_m * sigma_m);
  impl_->write(topic, sample.stamp, odometry_definition(), bytes.get());
}

void BagWriter::write_dvl(const std::string& topic, const DvlSample& sample) {
  Bytes bytes;
  bytes.put_header(sample.stamp).put(0.0).put_vector(sample.velocity);
  bytes.put(sample.figure_of_merit.value_or(0.0)).put(sample.altitude.value_or(-1.0));
  bytes.put(static_cast<std::uint32_t>(sample.beams.size()));
  for (std::size_t i = 0; i < sample.beams.size(); ++i) {
    const DvlBeam beam = sample.beams[i].value_or(DvlBeam{});
    bytes.put(static_cast<std::int64_t>(i)).put(beam.velocity).put(beam.range.value_or(-1.0));
    bytes.put_zeros(2).put(static_cast<std::uint8_t>(beam.valid));
  }
  bytes.put(static_cast<std::uint8_t>(sample.valid)).put(std::int64_t{0}).put_text("json_v3");
  impl_->write(topic, sample.stamp, waterlinked_dvl_definition(), bytes.get());
}

void BagWriter::write_pose(const std::string& topic, const StampedPose& pose) {
  const Bytes bytes = odometry(pose.stamp, pose.T_world_body, 0.0);
  impl_->write(topic, pose.stamp, odometry_definition(), bytes.get());
}

void BagWriter::write_image(const std::string& topic, Stamp stamp, const std::string& format,
                            const std::vector<std::uint8_t>& file) {
  Bytes bytes;
  bytes.put_header(stamp).put_text(format).put_block(file);
  impl_->write(topic, stamp, compressed_image_definition(), bytes.get());
}

void BagWriter::write_raw(const std::string& topic, Stamp stamp, const std::string& type,
                          const std::string& md5, const std::string& definition,
                          const std::vector<std::uint8_t>& bytes) {
  impl_->write(topic, stamp, {type, md5, definition}, bytes);
}

void BagWriter::close() {
  try {
    impl_->bag.close();
  } catch (const std::exception& e) {
    fail_run("{}: cannot complete this bag: {}", impl_->path, e.what());
  }
}

}  // namespace apvi::io
