// SPDX-License-Identifier: BSD-3-Clause
#include "live/waterlinked_link.hpp"

#include <array>
#include <utility>

#include "apvi/core/log.hpp"
#include "io/folder/waterlinked_report.hpp"
#include "live/host_clock.hpp"

namespace apvi::live {
namespace {

std::string text_of(const std::optional<double>& value, std::string_view unit) {
  return value ? fmt::format("{:g} {}", *value, unit) : "not reported";
}

}  // namespace

WaterLinkedLink::WaterLinkedLink(std::string name, const Address& address,
                                 const std::stop_token& stop)
    : name_(std::move(name)), socket_(Socket::connect_tcp(address, stop)) {
  constexpr std::string_view kQuestion = "{\"command\":\"get_config\"}\n";
  socket_.send({reinterpret_cast<const std::uint8_t*>(kQuestion.data()), kQuestion.size()});
}

bool WaterLinkedLink::receive(Receiver& receiver) {
  if (!socket_.wait(kPollPeriod)) return true;
  std::array<std::uint8_t, 8192> bytes{};
  const std::size_t size = socket_.read(bytes);
  const Stamp arrival = host_now();
  if (!lines_.append({reinterpret_cast<const char*>(bytes.data()), size})) {
    receiver.malformed("a line without an end");
  }
  while (const auto line = lines_.next()) take(*line, arrival, receiver);
  return true;
}

void WaterLinkedLink::take(std::string_view line, Stamp arrival, Receiver& receiver) {
  const io::WaterLinkedReport report = io::parse_waterlinked(line);
  if (!report.problem.empty()) return receiver.malformed(report.problem);
  if (report.settings) {
    log::info("{}: speed of sound {}, mounting rotation {}", name_,
              text_of(report.settings->speed_of_sound_m_s, "m/s"),
              text_of(report.settings->mounting_rotation_deg, "deg"));
  }
  if (!report.sample) return;
  if (report.water_track && !std::exchange(reported_water_, true)) {
    log::warning("{}: water track: velocities against the water are not used", name_);
  }
  receiver.sample(*report.sample,
                  {.sent = report.sent.value_or(report.sample->stamp), .arrival = arrival});
}

}  // namespace apvi::live
