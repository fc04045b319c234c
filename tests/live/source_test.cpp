// SPDX-License-Identifier: BSD-3-Clause
#include "live/source.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <vector>

#include "apvi/core/constants.hpp"
#include "apvi/core/error.hpp"
#include "core/stopwatch.hpp"
#include "io/mavlink/frame.hpp"
#include "live/host_clock.hpp"
#include "live/loopback.hpp"
#include "live/socket.hpp"
#include "live/sources.hpp"

namespace apvi::live {
namespace {

using test::eventually;
using test::TcpServer;
using testing::HasSubstr;

// A velocity report of a device whose clock is an hour late.
std::string report(double velocity) {
  const std::int64_t us = host_now().ns / 1000 - 3'600'000'000;
  return fmt::format(R"({{"vx":{},"vy":0,"vz":0,"velocity_valid":true,"type":"velocity",)"
                     R"("time_of_validity":{},"time_of_transmission":{}}})"
                     "\r\n",
                     velocity, us - 100'000, us);
}

struct Received {
  std::mutex mutex;
  std::vector<std::pair<DvlSample, Stamp>> pings;

  Source::Sink sink() {
    return [this](const SensorEvent& event, Stamp arrival) {
      const std::scoped_lock lock(mutex);
      pings.emplace_back(std::get<DvlSample>(event), arrival);
    };
  }
  std::size_t count() {
    const std::scoped_lock lock(mutex);
    return pings.size();
  }
};

std::string address_of(const TcpServer& server) {
  return fmt::format("waterlinked://127.0.0.1:{}", server.port());
}

void send_for(const TcpServer& server, double seconds) {
  for (const Stopwatch watch; watch.seconds() < seconds;) {
    server.send(report(0.5));
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
  }
}

TEST(WaterLinkedSource, GivesPingsByTheHostsClock) {
  TcpServer server;
  const auto named = make_source(address_of(server));
  EXPECT_EQ(named.source->kinds(), std::set<std::string>{"dvl"});
  Received received;
  named.source->start(received.sink());
  server.answer();
  EXPECT_THAT(server.receive(), HasSubstr("get_config"));
  server.send(R"({"response_to":"get_config","success":true,"result":{"speed_of_sound":1475}})"
              "\n");
  send_for(server, 1.3);
  ASSERT_TRUE(eventually([&] { return received.count() >= 5; }));
  named.source->stop();
  double least_age_s = 1.0;
  for (const auto& [ping, arrival] : received.pings) {
    EXPECT_EQ(ping.velocity.x(), 0.5);
    least_age_s = std::min(least_age_s, seconds_between(ping.stamp, arrival));
  }
  EXPECT_NEAR(least_age_s, 0.1, 0.02);  // valid so long before it was sent
  EXPECT_GT(named.source->status().warm_up, 10U);
}

TEST(WaterLinkedSource, ConnectsAgainAfterTheDeviceWasOff) {
  auto server = std::make_unique<TcpServer>();
  const std::uint16_t port = server->port();
  const auto named = make_source(address_of(*server));
  Received received;
  named.source->start(received.sink());
  server->answer();
  send_for(*server, 1.2);
  ASSERT_TRUE(eventually([&] { return received.count() > 0; }));
  server.reset();
  ASSERT_TRUE(eventually([&] { return named.source->status().state == ConnectionState::lost; }));
  const std::size_t before = received.count();
  server = std::make_unique<TcpServer>(port);
  server->answer();
  send_for(*server, 0.2);
  EXPECT_TRUE(eventually([&] { return received.count() > before; }));
  EXPECT_EQ(named.source->status().state, ConnectionState::receiving);
  EXPECT_EQ(named.source->status().losses, 1U);
}

TEST(WaterLinkedSource, MalformedLinesAreCountedAndSkipped) {
  TcpServer server;
  const auto named = make_source(address_of(server));
  Received received;
  named.source->start(received.sink());
  server.answer();
  server.send("{\"vx\":\n\xff\xfe{}}{\n" + std::string(100'000, 'x'));
  server.send("\n{\"type\":\"velocity\"}\n");
  send_for(server, 1.2);
  EXPECT_TRUE(eventually([&] { return received.count() > 0; }));
  EXPECT_GE(named.source->status().malformed, 3U);
}

// An autopilot that was started 100 s ago.
io::mavlink::Frame raw_imu() {
  static const Stamp booted = host_now() - Duration::from_seconds(100.0);
  io::mavlink::Frame frame{.system = 1, .component = 1, .id = io::mavlink::Id::raw_imu};
  frame.set<std::uint64_t>(0, static_cast<std::uint64_t>((host_now() - booted).ns / 1000));
  frame.set<std::int16_t>(12, -1000);
  return frame;
}

TEST(MavlinkSource, GivesInertialDataByTheHostsClock) {
  const std::uint16_t port = Socket::bind_udp({"127.0.0.1", 0}).port();
  const auto named = make_source(fmt::format("mavlink://udp:{}", port));
  std::mutex mutex;
  std::vector<std::pair<ImuSample, Stamp>> samples;
  named.source->start([&](const SensorEvent& event, Stamp arrival) {
    const std::scoped_lock lock(mutex);
    samples.emplace_back(std::get<ImuSample>(event), arrival);
  });
  Socket autopilot = Socket::connect_udp({"127.0.0.1", port});
  for (const Stopwatch watch; watch.seconds() < 1.5;) {
    autopilot.send(io::mavlink::encode(raw_imu(), 0));
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
  }
  named.source->stop();
  ASSERT_GT(samples.size(), 5U);
  double least_age_s = 1.0;
  for (const auto& [imu, arrival] : samples) {
    EXPECT_NEAR(imu.accel.z(), -kStandardGravity, 1e-9);
    least_age_s = std::min(least_age_s, seconds_between(imu.stamp, arrival));
  }
  EXPECT_NEAR(least_age_s, 0.0, 0.005);
  std::array<std::uint8_t, 512> bytes;
  EXPECT_TRUE(autopilot.wait(std::chrono::milliseconds(100)));  // a question for the time
  EXPECT_GT(autopilot.read(bytes), 0U);
}

TEST(Source, StopsAtOnceWhileItWaitsToTryAgain) {
  std::atomic<int> attempts = 0;
  Source source({.name = "device", .kinds = {}, .first_retry_s = 60.0, .last_retry_s = 60.0},
                [&](const std::stop_token&) -> std::unique_ptr<Link> {
                  ++attempts;
                  fail_run("not there");
                });
  source.start([](const SensorEvent&, Stamp) {});
  ASSERT_TRUE(eventually([&] { return source.status().state == ConnectionState::lost; }));
  const Stopwatch watch;
  source.stop();
  EXPECT_LT(watch.seconds(), 30.0);  // of 60 s
  EXPECT_EQ(attempts, 1);
}

TEST(Source, TriesAgainAtGrowingIntervals) {
  std::vector<double> times;
  const Stopwatch watch;
  Source source({.name = "device", .kinds = {}, .first_retry_s = 0.05, .last_retry_s = 0.2},
                [&](const std::stop_token&) -> std::unique_ptr<Link> {
                  times.push_back(watch.seconds());
                  fail_run("not there");
                });
  source.start([](const SensorEvent&, Stamp) {});
  std::this_thread::sleep_for(std::chrono::milliseconds(900));
  source.stop();
  ASSERT_GE(times.size(), 4U);
  EXPECT_GE(times[1] - times[0], 0.05);
  EXPECT_GE(times[2] - times[1], 0.1);
  EXPECT_GE(times[3] - times[2], 0.2);
  EXPECT_LE(times.size(), 7U);
}

TEST(Source, AddressesThatAreNoneAreErrors) {
  for (const char* address :
       {"waterlinked://", "mavlink://tcp:1", "mavlink://udp:x", "ftp://host",
        "mavlink://udp:1?imu=X", "waterlinked://host?speed=3", "mavlink://udp:1?imu"}) {
    EXPECT_THROW(make_source(address), InputError) << address;
  }
}

}  // namespace
}  // namespace apvi::live
