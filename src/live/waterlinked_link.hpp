// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <stop_token>
#include <string>

#include "live/line_buffer.hpp"
#include "live/link.hpp"
#include "live/socket.hpp"

namespace apvi::live {

inline constexpr std::uint16_t kWaterLinkedPort = 16171;

/// A DVL of Water Linked (A50, A125): a TCP server of JSON lines. Velocities have the stamp
/// `time_of_validity`; the clock is read from `time_of_transmission`, because the ping itself is up
/// to 0.2 s old when it is sent. Asks once for the settings and logs them.
class WaterLinkedLink : public Link {
 public:
  WaterLinkedLink(std::string name, const Address& address, const std::stop_token& stop);
  bool receive(Receiver& receiver) override;

 private:
  void take(std::string_view line, Stamp arrival, Receiver& receiver);

  std::string name_;  // for messages
  Socket socket_;
  LineBuffer lines_;
  bool reported_water_ = false;
};

}  // namespace apvi::live
