// SPDX-License-Identifier: BSD-3-Clause
#include "live/clock_aligner.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <cstdlib>

#include "core/random.hpp"

namespace apvi::live {
namespace {

// A device whose clock, and the delay of its messages, are known.
struct Device {
  double skew = 0.0;          // how much faster the host's clock runs
  double mean_delay_s = 0.0;  // exponential
  Duration offset{1'700'000'000'000'000'000};
  Random random{7};

  Stamp host(Stamp device) const {
    return device + offset + Duration::from_seconds(skew * device.seconds());
  }
  Stamp arrival(Stamp device) {
    return host(device) + Duration::from_seconds(-mean_delay_s * std::log(1.0 - random.uniform()));
  }
};

Stamp at(double seconds) {
  return Stamp{} + Duration::from_seconds(seconds);
}

// Largest error [s] from `from_s` on, of `rate_hz` messages a second up to `until_s`.
double worst_error(ClockAligner& aligner, Device& device, double rate_hz, double from_s,
                   double until_s) {
  double worst = 0.0;
  for (int i = 0; i < static_cast<int>(until_s * rate_hz); ++i) {
    const Stamp stamp = at(i / rate_hz);
    aligner.add(stamp, device.arrival(stamp));
    const double error = seconds_between(device.host(stamp), aligner.to_host(stamp));
    if (stamp.seconds() >= from_s) worst = std::max(worst, std::abs(error));
  }
  return worst;
}

TEST(ClockAligner, IsExactWithoutDelay) {
  ClockAligner aligner;
  Device device;
  EXPECT_LT(worst_error(aligner, device, 10.0, 0.0, 100.0), 1e-9);
  EXPECT_EQ(aligner.steps(), 0U);
}

TEST(ClockAligner, ErrorIsBelowAMillisecondWithExponentialJitterAndSkew) {
  for (const double skew : {50e-6, -50e-6, 0.0}) {
    ClockAligner imu;
    Device device{.skew = skew, .mean_delay_s = 0.005};
    EXPECT_LT(worst_error(imu, device, 200.0, 3.0, 300.0), 1e-3) << skew;
    EXPECT_NEAR(imu.skew(), skew, 10e-6);
    EXPECT_EQ(imu.steps(), 0U);
  }
}

TEST(ClockAligner, SlowMessagesAreAlignedToAMillisecondOnceTheSkewIsKnown) {
  ClockAligner dvl;
  Device device{.skew = 50e-6, .mean_delay_s = 0.005};
  EXPECT_LT(worst_error(dvl, device, 5.0, 30.0, 300.0), 1e-3);
}

TEST(ClockAligner, HostTimesIncreaseWithDeviceTimes) {
  ClockAligner aligner;
  Device device{.skew = -50e-6, .mean_delay_s = 0.02};
  Stamp last = Stamp::min();
  for (int i = 0; i < 20'000; ++i) {
    const Stamp stamp = at(0.005 * i);
    aligner.add(stamp, device.arrival(stamp));
    if (!aligner.ready()) continue;
    EXPECT_GT(aligner.to_host(stamp), last);
    last = aligner.to_host(stamp);
  }
}

TEST(ClockAligner, IsReadyAfterASecond) {
  ClockAligner aligner;
  Device device;
  worst_error(aligner, device, 10.0, 0.0, 0.95);
  EXPECT_FALSE(aligner.ready());
  worst_error(aligner, device, 10.0, 0.0, 1.15);
  EXPECT_TRUE(aligner.ready());
}

TEST(ClockAligner, FollowsAStepForwardAtOnce) {
  ClockAligner aligner;
  Device device{.mean_delay_s = 0.001};
  worst_error(aligner, device, 100.0, 0.0, 20.0);
  device.offset = device.offset - Duration{2'000'000'000};  // the device's clock jumps by 2 s
  const Stamp stamp = at(22.0);
  aligner.add(stamp, device.arrival(stamp));
  EXPECT_NEAR(seconds_between(device.host(stamp), aligner.to_host(stamp)), 0.0, 0.01);
  EXPECT_EQ(aligner.steps(), 1U);
  EXPECT_NEAR(aligner.last_step().seconds(), 2.0, 0.01);
}

TEST(ClockAligner, FollowsAClockThatIsSetBackAfterASecond) {
  ClockAligner aligner;
  Device device{.mean_delay_s = 0.001};
  worst_error(aligner, device, 100.0, 0.0, 20.0);
  device.offset = device.offset + Duration{2'000'000'000};
  for (double s = 18.0; s < 19.3; s += 0.01) aligner.add(at(s), device.arrival(at(s)));
  EXPECT_NEAR(seconds_between(device.host(at(19.3)), aligner.to_host(at(19.3))), 0.0, 0.005);
  EXPECT_EQ(aligner.steps(), 1U);
  EXPECT_NEAR(aligner.last_step().seconds(), -2.0, 0.01);
}

TEST(ClockAligner, AStalledLinkIsNoStep) {
  ClockAligner aligner;
  Device device{.mean_delay_s = 0.001};
  worst_error(aligner, device, 100.0, 0.0, 20.0);
  for (double s = 20.0; s < 23.0; s += 0.01) aligner.add(at(s), device.host(at(23.0)));  // a burst
  for (double s = 23.0; s < 25.0; s += 0.01) aligner.add(at(s), device.arrival(at(s)));
  EXPECT_EQ(aligner.steps(), 0U);
  EXPECT_NEAR(seconds_between(device.host(at(25.0)), aligner.to_host(at(25.0))), 0.0, 1e-3);
}

}  // namespace
}  // namespace apvi::live
