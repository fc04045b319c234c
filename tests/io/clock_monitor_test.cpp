// SPDX-License-Identifier: BSD-3-Clause
#include "io/clock_monitor.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <utility>

#include "io/merged_reader.hpp"

namespace apvi::io {
namespace {

constexpr double kDay = 86400.0;

class FakeSource : public SampleSource {
 public:
  explicit FakeSource(std::vector<SensorEvent> events) : events_(std::move(events)) {}
  SourceState next(SensorEvent& event) override {
    if (at_ == events_.size()) return SourceState::end;
    event = events_[at_++];
    return SourceState::sample;
  }
  std::string where() const override { return "row " + std::to_string(at_); }
  double fraction() const override { return 0.0; }

 private:
  std::vector<SensorEvent> events_;
  std::size_t at_ = 0;
};

// Samples of a recording of 300 s, by kind and time; `clock` gives the stamp at a time.
using Clock = std::function<double(double)>;

template <typename Sample>
std::vector<SensorEvent> samples(double period_s, const Clock& clock) {
  std::vector<SensorEvent> events;
  const int count = static_cast<int>(std::lround(300.0 / period_s));
  for (int i = 0; i < count; ++i) {
    Sample sample;
    sample.stamp = Stamp{} + Duration::from_seconds(clock(i * period_s));
    events.emplace_back(sample);
  }
  return events;
}

struct Outcome {
  std::map<std::string, std::size_t> delivered;
  std::map<std::string, std::size_t> dropped;
  std::vector<double> stamps;
};

Outcome read(std::vector<SensorEvent> imu, std::vector<SensorEvent> dvl) {
  Recording recording;
  recording.add("imu", std::make_unique<FakeSource>(std::move(imu)));
  recording.add("dvl", std::make_unique<FakeSource>(std::move(dvl)));
  MergedReader reader(std::move(recording), DatasetConfig{});
  Outcome outcome;
  while (const auto event = reader.next()) outcome.stamps.push_back(stamp_of(*event).seconds());
  for (const auto& [kind, report] : reader.report()) {
    outcome.delivered[kind] = report.delivered;
    for (const auto& [reason, count] : report.dropped) outcome.dropped[kind] += count;
  }
  return outcome;
}

Outcome read(const Clock& imu, const Clock& dvl) {
  return read(samples<ImuSample>(0.1, imu), samples<DvlSample>(0.5, dvl));
}

double regular(double t) {
  return 10.0 * kDay + t;
}

// A device that gets its time over the network counts from 1970 until then.
TEST(ClockMonitor, FirstStampsOfOneSensorMayBeOfAClockThatWasNotSetYet) {
  const Clock set_later = [](double t) { return t < 3.0 ? t : regular(t); };
  const Outcome imu = read(set_later, regular);
  EXPECT_EQ(imu.delivered.at("imu"), 2970U);
  EXPECT_EQ(imu.dropped.at("imu"), 30U);
  EXPECT_EQ(imu.delivered.at("dvl"), 600U);
  EXPECT_EQ(imu.stamps.front(), regular(0.0));
  const Outcome dvl = read(regular, set_later);
  EXPECT_EQ(dvl.delivered.at("imu"), 3000U);
  EXPECT_EQ(dvl.delivered.at("dvl"), 594U);
  const Clock zero = [](double t) { return t < 3.0 ? 0.0 : regular(t); };
  EXPECT_EQ(read(regular, zero).delivered.at("dvl"), 594U);
}

TEST(ClockMonitor, OneSensorMayBeginOnlyAfterTheClockOfAllWasSet) {
  const Clock set_later = [](double t) { return t < 3.0 ? t : regular(t); };
  auto dvl = samples<DvlSample>(0.5, regular);
  dvl.erase(dvl.begin(), dvl.begin() + 20);
  const Outcome out = read(samples<ImuSample>(0.1, set_later), std::move(dvl));
  EXPECT_EQ(out.delivered.at("imu"), 2970U);
  EXPECT_EQ(out.delivered.at("dvl"), 580U);
  EXPECT_EQ(out.stamps.front(), regular(3.0));
}

TEST(ClockMonitor, SamplesOfAnotherClockThatIsNeverSetAreKeptApart) {
  const Outcome out = read([](double t) { return t; }, regular);
  EXPECT_EQ(out.delivered.at("imu"), 3000U);
  EXPECT_EQ(out.delivered.at("dvl"), 600U);
}

TEST(ClockMonitor, PassesARegularRecording) {
  const Outcome out = read(regular, regular);
  EXPECT_EQ(out.delivered.at("imu"), 3000U);
  EXPECT_EQ(out.delivered.at("dvl"), 600U);
}

TEST(ClockMonitor, AClockSetForAllSensorsLosesNothing) {
  for (const double jump : {-5.0 * kDay, -600.0, 2.0 * kDay, 17000.0 * kDay}) {
    const auto set = [jump](double t) { return regular(t) + (t < 100.0 ? 0.0 : jump); };
    const Outcome out = read(set, set);
    EXPECT_EQ(out.delivered.at("imu"), 3000U) << jump;
    EXPECT_EQ(out.delivered.at("dvl"), 600U) << jump;
    EXPECT_TRUE(std::is_sorted(out.stamps.begin(), out.stamps.end())) << jump;
    const double span = out.stamps.back() - out.stamps.front();
    EXPECT_NEAR(span, 300.0 + std::max(jump, 10.0), 1.0) << jump;
  }
}

TEST(ClockMonitor, ASetClockIsRecognizedWhenOneSensorWasSilentBefore) {
  for (const double jump : {-5.0 * kDay, 17000.0 * kDay}) {
    const auto set = [jump](double t) { return regular(t) + (t < 100.0 ? 0.0 : jump); };
    std::vector<SensorEvent> dvl = samples<DvlSample>(0.5, set);
    dvl.erase(dvl.begin() + 120, dvl.begin() + 200);  // from 60 s to 100 s
    const Outcome out = read(samples<ImuSample>(0.1, set), dvl);
    EXPECT_EQ(out.delivered.at("imu"), 3000U) << jump;
    EXPECT_EQ(out.delivered.at("dvl"), 520U) << jump;
  }
}

TEST(ClockMonitor, SamplesOfOneWrongClockAreDroppedUntilItReturns) {
  for (const double jump : {-5.0 * kDay, 17000.0 * kDay}) {
    for (const double length : {5.0, 30.0, 150.0}) {
      const auto dvl = [=](double t) {
        return regular(t) + (t >= 100.0 && t < 100.0 + length ? jump : 0.0);
      };
      const Outcome out = read(regular, dvl);
      EXPECT_EQ(out.delivered.at("imu"), 3000U);
      const auto wrong = static_cast<std::size_t>(2.0 * length);
      EXPECT_EQ(out.dropped.at("dvl"), wrong) << jump << " for " << length;
      EXPECT_EQ(out.delivered.at("dvl"), 600U - wrong) << jump << " for " << length;
    }
  }
}

TEST(ClockMonitor, AClockSetShortlyBeforeTheEndIsThatOfOneSensorIfTheOthersContinue) {
  for (const double jump : {-3600.0, -5.0 * kDay}) {
    for (const double since : {250.0, 290.0}) {
      const auto dvl = [=](double t) { return regular(t) + (t < since ? 0.0 : jump); };
      const Outcome out = read(regular, dvl);
      EXPECT_EQ(out.delivered.at("imu"), 3000U) << jump;
      EXPECT_EQ(out.delivered.at("dvl"), static_cast<std::size_t>(2.0 * since)) << jump;
      EXPECT_NEAR(out.stamps.back() - out.stamps.front(), 300.0, 1.0) << jump;
      const Outcome other = read(dvl, regular);
      EXPECT_EQ(other.delivered.at("imu"), static_cast<std::size_t>(10.0 * since)) << jump;
      EXPECT_EQ(other.delivered.at("dvl"), 600U) << jump;
    }
  }
}

TEST(ClockMonitor, SamplesOfAClockThatNeverReturnsAreDropped) {
  for (const double jump : {-5.0 * kDay, 17000.0 * kDay}) {
    const auto dvl = [=](double t) { return regular(t) + (t >= 100.0 ? jump : 0.0); };
    const Outcome out = read(regular, dvl);
    EXPECT_EQ(out.delivered.at("imu"), 3000U) << jump;
    EXPECT_EQ(out.delivered.at("dvl"), 200U) << jump;
    EXPECT_EQ(out.dropped.at("dvl"), 400U) << jump;
  }
}

TEST(ClockMonitor, AClockThatIsSetAndReturnsForAllSensorsIsCorrected) {
  for (const double jump : {-600.0, -20.0, -5.0 * kDay, 17000.0 * kDay}) {
    for (const double length : {5.0, 15.0, 100.0}) {
      if (length > -jump && jump < 0.0) continue;  // comes to the stamps before it
      const auto clock = [=](double t) {
        return regular(t) + (t >= 100.0 && t < 100.0 + length ? jump : 0.0);
      };
      const Outcome out = read(clock, clock);
      EXPECT_EQ(out.delivered.at("imu"), 3000U) << jump << " for " << length;
      EXPECT_EQ(out.delivered.at("dvl"), 600U) << jump << " for " << length;
      EXPECT_NEAR(out.stamps.back() - out.stamps.front(), 300.0, 0.5) << jump;
      for (std::size_t i = 1; i < out.stamps.size(); ++i) {
        ASSERT_LT(out.stamps[i] - out.stamps[i - 1], 0.11) << jump << " for " << length;
      }
    }
  }
}

TEST(ClockMonitor, NothingIsLostAfterTheClockOfTheFastestSensorReturns) {
  const auto imu = [](double t) { return regular(t) - (t >= 100.0 && t < 130.0 ? 600.0 : 0.0); };
  const Outcome out = read(imu, regular);
  EXPECT_EQ(out.delivered.at("imu"), 2700U);
  EXPECT_EQ(out.delivered.at("dvl"), 600U);
}

TEST(ClockMonitor, AClockThatIsSetBackBySecondsLosesNothing) {
  const auto set = [](double t) { return regular(t) - (t < 100.0 ? 0.0 : 20.0); };
  const Outcome out = read(set, set);
  EXPECT_EQ(out.delivered.at("imu"), 3000U);
  EXPECT_EQ(out.delivered.at("dvl"), 600U);
  EXPECT_NEAR(out.stamps.back() - out.stamps.front(), 310.0, 1.0);
}

TEST(ClockMonitor, AWrongFirstStampDoesNotDropTheRest) {
  std::vector<SensorEvent> dvl = samples<DvlSample>(0.5, regular);
  std::get<DvlSample>(dvl.front()).stamp = Stamp{0};
  const Outcome out = read(samples<ImuSample>(0.1, regular), dvl);
  EXPECT_EQ(out.delivered.at("dvl"), 599U);
}

}  // namespace
}  // namespace apvi::io
