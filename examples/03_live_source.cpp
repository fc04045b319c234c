// SPDX-License-Identifier: BSD-3-Clause
// A thread acts as the sensor drivers and pushes samples in real time; the main thread estimates
// and prints poses as TUM lines.
//
//   03_live_source DIVE/ [SPEED]
#include <chrono>
#include <cstdio>
#include <optional>
#include <string>
#include <thread>

#include "apvi/apvi.hpp"

namespace {

// Replaces the sensor drivers, each of which may use its own thread.
void drive(apvi::io::SequenceReader& recording, double speed, apvi::io::LiveSequence& live) {
  const auto begin = std::chrono::steady_clock::now();
  std::optional<apvi::Stamp> first;
  try {
    while (const auto sample = recording.next()) {
      const apvi::Stamp stamp = apvi::stamp_of(*sample);
      if (!first) first = stamp;
      const double due_s = apvi::seconds_between(*first, stamp) / speed;
      std::this_thread::sleep_until(begin + std::chrono::duration<double>(due_s));
      if (!live.push(*sample)) return;  // the sequence has ended
    }
    live.finish();
  } catch (...) {
    live.fail(std::current_exception());  // rethrown in the estimator's thread
  }
}

void localize(const std::string& path, double speed) {
  apvi::io::DatasetConfig dataset;
  dataset.path = path;
  apvi::localization::Options options;
  options.run.mode = apvi::localization::RunMode::realtime;
  const auto recording = apvi::io::open_sequence(dataset, options.sensors.use);

  apvi::localization::SystemCallbacks callbacks;
  callbacks.pose = [](const apvi::StampedPose& pose) {
    std::fputs(apvi::io::tum_line(pose).c_str(), stdout);
  };
  apvi::localization::System system(options, apvi::make_rig(recording->rig()), callbacks);
  apvi::io::LiveSequence live(recording->rig());
  const std::jthread driver([&](std::stop_token stop) {
    const std::stop_callback on_stop(stop, [&live] { live.stop(); });  // if `system` throws
    drive(*recording, speed, live);
  });
  while (const auto sample = live.next()) system.process(*sample);
  system.finish();
}

}  // namespace

int main(int argc, char** argv) {
  if (argc < 2) {
    std::fputs("usage: 03_live_source DIVE/ [SPEED]\n", stderr);
    return 2;
  }
  try {
    localize(argv[1], argc > 2 ? std::stod(argv[2]) : 1.0);
  } catch (const std::exception& error) {
    apvi::log::error("{}", error.what());
    return 1;
  }
  return 0;
}
