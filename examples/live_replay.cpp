// SPDX-License-Identifier: BSD-3-Clause
// Localization inside a program of one's own: a thread plays the part of the sensors' drivers and
// pushes samples as they come; the main thread estimates and prints poses as TUM lines.
//
//   live_replay CONFIG RECORDING [SPEED]     e.g. configs/default.yaml my_dive/ 1
#include <chrono>
#include <cstdio>
#include <exception>
#include <optional>
#include <string>
#include <thread>

#include "apvi/core/log.hpp"
#include "apvi/io/live_sequence.hpp"
#include "apvi/io/tum.hpp"
#include "apvi/pipeline/system.hpp"

namespace {

// What the drivers of real sensors would do, each on a thread of its own if they like.
void drive(apvi::io::SequenceReader& recording, double speed, apvi::io::LiveSequence& live) {
  const auto begin = std::chrono::steady_clock::now();
  std::optional<apvi::Stamp> first;
  try {
    while (const auto event = recording.next()) {
      const apvi::Stamp stamp = apvi::stamp_of(*event);
      if (!first) first = stamp;
      const double due_s = apvi::seconds_between(*first, stamp) / speed;
      std::this_thread::sleep_until(begin + std::chrono::duration<double>(due_s));
      if (!live.push(*event)) return;  // nobody listens any more
    }
    live.finish();
  } catch (...) {
    live.fail(std::current_exception());  // the estimator's thread hears of it
  }
}

void localize(const std::string& config_file, const std::string& path, double speed) {
  const auto config =
      apvi::pipeline::load_run_config(config_file, {"dataset.path=" + path, "run.mode=realtime"});
  const auto recording = apvi::io::open_sequence(config.dataset, config.sensors.use);
  const apvi::config::Node rig_node = apvi::pipeline::rig_of(config, recording->rig());
  const apvi::Rig rig = apvi::make_rig(rig_node);
  const bool has_images = recording->report().contains("camera");

  apvi::pipeline::System system(
      config, rig, apvi::pipeline::find_sensors(config, rig, has_images),
      {.pose = [](const auto& p) { std::fputs(apvi::io::tum_line(p).c_str(), stdout); }});
  apvi::io::LiveSequence live(rig_node);
  const std::jthread driver([&](std::stop_token stop) {
    const std::stop_callback on_stop(stop, [&live] { live.stop(); });  // should `system` throw
    drive(*recording, speed, live);
  });
  while (const auto event = live.next()) system.process(*event);
  system.finish();
}

}  // namespace

int main(int argc, char** argv) {
  if (argc < 3) {
    std::fputs("usage: live_replay CONFIG RECORDING [SPEED]\n", stderr);
    return 2;
  }
  try {
    localize(argv[1], argv[2], argc > 3 ? std::stod(argv[3]) : 1.0);
  } catch (const std::exception& error) {
    apvi::log::error("{}", error.what());
    return 1;
  }
  return 0;
}
