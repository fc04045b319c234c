// SPDX-License-Identifier: BSD-3-Clause
#include "live/sources.hpp"

#include <filesystem>
#include <utility>
#include <vector>

#include "apvi/core/error.hpp"
#include "apvi/io/sequence.hpp"
#include "core/text.hpp"
#include "live/mavlink_link.hpp"
#include "live/playback_link.hpp"
#include "live/source_url.hpp"
#include "live/video_link.hpp"
#include "live/waterlinked_link.hpp"

namespace apvi::live {
namespace {

NamedSource device(SourceOptions options, Source::Open open) {
  return {std::make_unique<Source>(std::move(options), std::move(open)), {}};
}

NamedSource waterlinked(const SourceUrl& url) {
  url.check_options({});
  const auto address = parse_address(url.target, kWaterLinkedPort);
  if (!address || address->host.empty()) {
    fail_input("{}: expected waterlinked://HOST[:PORT]", url.text);
  }
  return device({.name = url.text, .kinds = {"dvl"}}, [=, name = url.text](std::stop_token stop) {
    return std::make_unique<WaterLinkedLink>(name, *address, stop);
  });
}

std::optional<mavlink::Id> message_option(const SourceUrl& url, const std::string& key) {
  const auto found = url.options.find(key);
  if (found == url.options.end()) return std::nullopt;
  const auto id = mavlink::sensor_message(found->second);
  if (!id) fail_input("{}: {}: unknown message {}", url.text, key, found->second);
  return id;
}

NamedSource mavlink_source(const SourceUrl& url) {
  url.check_options({"imu", "pressure"});
  constexpr std::string_view kUdp = "udp:";
  const bool is_udp = url.target.starts_with(kUdp);
  const auto address = is_udp ? parse_address(url.target.substr(kUdp.size())) : std::nullopt;
  if (!address) {
    fail_input("{}: expected mavlink://udp:PORT or mavlink://udp:HOST:PORT", url.text);
  }
  const MavlinkOptions options{.name = url.text,
                               .address = *address,
                               .listen = address->host.empty(),
                               .imu = message_option(url, "imu"),
                               .pressure = message_option(url, "pressure")};
  return device(
      {.name = url.text, .kinds = {"imu", "pressure"}, .reopen_when_silent = false},
      [options](const std::stop_token&) { return std::make_unique<MavlinkLink>(options); });
}

NamedSource video(const SourceUrl& url) {
  const VideoOptions options = video_options(url);
  return device({.name = url.text, .kinds = {"camera"}},
                [options](const std::stop_token&) { return std::make_unique<VideoLink>(options); });
}

std::vector<std::string> list_option(const SourceUrl& url, const std::string& key) {
  const auto found = url.options.find(key);
  if (found == url.options.end()) return {"camera", "imu", "dvl", "pressure"};
  std::vector<std::string_view> parts;
  text::split(found->second, ',', parts);
  return {parts.begin(), parts.end()};
}

NamedSource playback(const SourceUrl& url) {
  url.check_options({"speed", "sensors"});
  const double speed = url.number("speed", 1.0, 0.01, 100.0);
  const std::vector<std::string> sensors = list_option(url, "sensors");
  io::DatasetConfig dataset;
  dataset.path = url.target;
  const auto recording = io::open_sequence(dataset, sensors);
  SourceOptions options{.name = url.text, .kinds = {}};
  for (const auto& [kind, report] : recording->report()) options.kinds.insert(kind);
  NamedSource named = device(options, [=, path = url.target](const std::stop_token&) {
    return std::make_unique<PlaybackLink>(path, sensors, speed);
  });
  named.rig = recording->rig();
  return named;
}

}  // namespace

NamedSource make_source(const std::string& address) {
  const SourceUrl url = SourceUrl::parse(address);
  if (url.scheme.empty() || url.scheme == "play") return playback(url);
  if (url.scheme == "waterlinked") return waterlinked(url);
  if (url.scheme == "mavlink") return mavlink_source(url);
  if (is_video_scheme(url.scheme)) return video(url);
  fail_input(
      "{}: not a source; expected waterlinked://, mavlink://, rtsp://, rtp+h264://, v4l2://, "
      "video:// or a recording",
      address);
}

bool is_video_address(const std::string& address) {
  return is_video_scheme(SourceUrl::parse(address).scheme);
}

}  // namespace apvi::live
