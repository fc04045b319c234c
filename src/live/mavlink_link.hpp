// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "io/mavlink/messages.hpp"
#include "live/link.hpp"
#include "live/socket.hpp"

namespace apvi::live {

namespace mavlink = io::mavlink;

/// Which of several messages with the same kind of data is used: the given one, else the first of
/// the list that arrives.
class MessageChoice {
 public:
  /// `best_first`: messages that serve.
  MessageChoice(std::vector<mavlink::Id> best_first, std::optional<mavlink::Id> given);
  bool accepts(mavlink::Id id);
  /// Whether the last call of `accepts` changed the choice.
  bool changed() const { return changed_; }

 private:
  std::vector<mavlink::Id> candidates_;  // better ones than the chosen, and that one last
  std::optional<mavlink::Id> chosen_;
  bool changed_ = false;
};

struct MavlinkOptions {
  std::string name;  ///< for messages
  Address address;
  bool listen = true;  ///< else sends to the address, so that the vehicle answers
  std::optional<mavlink::Id> imu;
  std::optional<mavlink::Id> pressure;
};

/// IMU and pressure of an autopilot by MAVLink on UDP. Stamps are the autopilot's; its clock is
/// read from all messages with a time, and from TIMESYNC, which is asked once a second and takes
/// the delay of the link out.
class MavlinkLink : public Link {
 public:
  explicit MavlinkLink(MavlinkOptions options);
  bool receive(Receiver& receiver) override;
  std::uint16_t port() const { return socket_.port(); }

 private:
  void take(const mavlink::Frame& frame, Stamp arrival, Receiver& receiver);
  void take(const mavlink::Imu& imu, Stamp arrival, Receiver& receiver);
  void take(const mavlink::Pressure& pressure, Stamp arrival, Receiver& receiver);
  void take(const mavlink::SystemTime& time, Stamp arrival, Receiver& receiver);
  void take(const mavlink::TimeSync& sync, Stamp arrival, Receiver& receiver);
  template <typename Other>
  void take(const Other&, Stamp, Receiver&) {}  // nothing that a run uses
  bool is_from_vehicle(const mavlink::Frame& frame, const mavlink::Message& message);
  void ask(Stamp now);
  void send(const mavlink::Frame& frame);

  MavlinkOptions options_;
  Socket socket_;
  MessageChoice imu_;
  MessageChoice pressure_;
  std::optional<std::uint8_t> system_;  // of the vehicle: that of the first sensor data
  Stamp asked_;
  std::uint8_t sequence_ = 0;
};

}  // namespace apvi::live
