// SPDX-License-Identifier: BSD-3-Clause
#include "live/pose_output.hpp"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <csignal>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <string_view>
#include <utility>

#include "apvi/core/error.hpp"
#include "apvi/core/log.hpp"
#include "apvi/io/tum.hpp"
#include "live/mavlink_poses.hpp"
#include "live/socket.hpp"

namespace apvi::live {
namespace {

/// A file, or a named pipe that has a reader now and then: lines without a reader are lost.
class TumSink : public PoseSink {
 public:
  explicit TumSink(std::string path) : path_(std::move(path)) {
    std::error_code none;
    is_pipe_ = std::filesystem::is_fifo(path_, none);
    if (!is_pipe_ && !open(O_CREAT | O_TRUNC)) fail_run("{}: cannot be written", path_);
    if (is_pipe_) std::signal(SIGPIPE, SIG_IGN);  // of a reader that goes
  }
  ~TumSink() override { close(); }

  void write(const PoseOutput& pose) override {
    if (file_ < 0 && !open(0)) return;
    const std::string line = io::tum_line({pose.stamp, pose.T_world_body});
    if (::write(file_, line.data(), line.size()) >= 0 || errno == EAGAIN) return;
    if (!is_pipe_ && !std::exchange(reported_, true)) log::error("{}: cannot be written", path_);
    if (is_pipe_) close();
  }

 private:
  bool open(int flags) {
    file_ = ::open(path_.c_str(), O_WRONLY | O_NONBLOCK | O_CLOEXEC | flags, 0644);
    return file_ >= 0;
  }
  void close() {
    if (file_ >= 0) ::close(file_);
    file_ = -1;
  }

  std::string path_;
  int file_ = -1;
  bool is_pipe_ = false;
  bool reported_ = false;
};

class UdpSink : public PoseSink {
 public:
  explicit UdpSink(const Address& address) : socket_(Socket::connect_udp(address)) {}

  void write(const PoseOutput& pose) override {
    const std::string line = pose_json(pose);
    socket_.send({reinterpret_cast<const std::uint8_t*>(line.data()), line.size()});
  }

 private:
  Socket socket_;
};

class MavlinkSink : public PoseSink {
 public:
  MavlinkSink(const Address& address, bool world_is_up)
      : socket_(Socket::connect_udp(address)), world_is_up_(world_is_up) {}

  void write(const PoseOutput& pose) override {
    send(mavlink_odometry(pose, world_is_up_));
    if (last_) {
      if (const auto delta = mavlink_position_delta(*last_, pose)) send(*delta);
    }
    last_ = pose;
  }

 private:
  void send(const io::mavlink::Frame& frame) {
    socket_.send(io::mavlink::encode(frame, sequence_++));
  }

  Socket socket_;
  bool world_is_up_;
  std::uint8_t sequence_ = 0;
  std::optional<PoseOutput> last_;
};

std::array<double, 3> array_of(const Eigen::Vector3d& v) {
  return {v.x(), v.y(), v.z()};
}

}  // namespace

std::unique_ptr<PoseSink> make_pose_sink(const std::string& text, bool world_is_up) {
  constexpr std::string_view kTum = "tum:";
  constexpr std::string_view kUdp = "udp://";
  constexpr std::string_view kMavlink = "mavlink://udp:";
  if (text.starts_with(kTum) && text.size() > kTum.size()) {
    return std::make_unique<TumSink>(text.substr(kTum.size()));
  }
  if (text.starts_with(kUdp)) {
    const auto address = parse_address(text.substr(kUdp.size()));
    if (address && !address->host.empty()) return std::make_unique<UdpSink>(*address);
  }
  if (text.starts_with(kMavlink)) {
    const auto address = parse_address(text.substr(kMavlink.size()));
    if (address && !address->host.empty()) {
      return std::make_unique<MavlinkSink>(*address, world_is_up);
    }
  }
  fail_input("{}: not an output; expected tum:PATH, udp://HOST:PORT or mavlink://udp:HOST:PORT",
             text);
}

PoseOutputs::PoseOutputs(const std::vector<std::string>& outputs, double max_rate_hz,
                         bool world_is_up)
    : period_s_(max_rate_hz > 0.0 ? 1.0 / max_rate_hz : 0.0) {
  for (const std::string& output : outputs) sinks_.push_back(make_pose_sink(output, world_is_up));
}

void PoseOutputs::write(const PoseOutput& pose) {
  // A tenth of the period is left for the jitter of stamps.
  constexpr double kTolerance = 0.9;
  if (!pose.trusted) return;
  if (last_ && seconds_between(*last_, pose.stamp) < kTolerance * period_s_) return;
  last_ = pose.stamp;
  for (const auto& sink : sinks_) sink->write(pose);
}

std::string pose_json(const PoseOutput& pose) {
  const Eigen::Quaterniond& q = pose.T_world_body.rotation;
  nlohmann::ordered_json json = {{"stamp_ns", pose.stamp.ns},
                                 {"position", array_of(pose.T_world_body.translation)},
                                 {"quaternion", {q.w(), q.x(), q.y(), q.z()}}};
  if (pose.v_body) json["velocity_body"] = array_of(*pose.v_body);
  if (pose.covariance) {
    for (int i = 0; i < 6; ++i) {
      const Eigen::Matrix<double, 1, 6> row = pose.covariance->row(i);
      json["covariance"].push_back(std::vector<double>(row.data(), row.data() + row.size()));
    }
  }
  json["reset_counter"] = pose.resets;
  json["trusted"] = pose.trusted;
  return json.dump() + "\n";
}

}  // namespace apvi::live
