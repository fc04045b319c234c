// SPDX-License-Identifier: BSD-3-Clause
#include "runs/live/live_run.hpp"

#include <fmt/format.h>

#include <nlohmann/json.hpp>
#include <set>
#include <utility>
#include <vector>

#include "apvi/core/error.hpp"
#include "apvi/core/log.hpp"
#include "eval/metrics_file.hpp"
#include "live/host_clock.hpp"
#include "live/sources.hpp"

namespace apvi::runs {
namespace {

namespace fs = std::filesystem;

struct OpenedSources {
  std::vector<std::unique_ptr<live::Source>> sources;
  std::set<std::string> kinds;
  config::Node rig;  // of a recording
};

OpenedSources open_sources(const std::vector<std::string>& addresses) {
  if (addresses.empty()) fail_input("live.sources: missing; name a source");
  OpenedSources opened;
  for (const std::string& address : addresses) {
    live::NamedSource named = live::make_source(address);
    opened.kinds.insert(named.source->kinds().begin(), named.source->kinds().end());
    if (opened.rig.is_null()) opened.rig = named.rig;
    opened.sources.push_back(std::move(named.source));
  }
  return opened;
}

RunConfig live_config(RunConfig config, const fs::path& folder, std::set<std::string> kinds) {
  config.run.mode = localization::RunMode::realtime;
  config.dataset.path = (folder / kRecordingFolder).string();
  if (kinds.contains("depth")) kinds.insert("pressure");
  std::erase_if(config.sensors.use, [&](const std::string& s) { return !kinds.contains(s); });
  return config;
}

eval::Json sources_json(const std::vector<live::SourceStatus>& sources) {
  eval::Json json = eval::Json::object();
  for (const live::SourceStatus& s : sources) {
    json[s.name] = {{"samples", s.samples},
                    {"discarded_before_clock_was_known", s.warm_up},
                    {"malformed", s.malformed},
                    {"losses", s.losses},
                    {"clock_steps", s.clock_steps}};
  }
  return json;
}

eval::Json latency_json(const live::Percentiles& p) {
  return {{"p50_s", p.p50_s}, {"p95_s", p.p95_s}, {"p99_s", p.p99_s}, {"poses", p.count}};
}

}  // namespace

LiveRun::LiveRun(const RunConfig& config, fs::path folder, std::function<bool()> interrupted)
    : folder_(std::move(folder)) {
  OpenedSources opened = open_sources(config.live.sources);
  config_ = live_config(config, folder_, opened.kinds);
  const config::Node rig = resolve_rig(config_, opened.rig);
  const bool world_is_up = make_rig(rig).world == WorldFrame::up;
  outputs_.emplace(config_.live.outputs, config_.live.output_rate_hz, world_is_up);
  if (config_.live.record) recorder_.emplace(config_.dataset.path, rig, config_.live.image_format);
  const bool camera = config_.sensors.includes("camera");
  session_ = std::make_unique<live::Session>(
      std::move(opened.sources), rig,
      live::SessionOptions{.max_wait_s = config_.live.max_wait_s,
                           .duration_s = config_.live.duration_s,
                           .recorder = recorder_ ? &*recorder_ : nullptr,
                           .latency = &latency_,
                           .latency_kind = camera ? "camera" : "dvl"});
  hooks_.begin = [this, stop = std::move(interrupted)] { session_->start(stop); };
  hooks_.frame = [this](const localization::FrameOutput& output) {
    if (const auto pose = poses_.of(output)) publish(*pose);
  };
  hooks_.ping = [this](const localization::PingOutput& output) { publish(poses_.of(output)); };
  hooks_.status = [this] { return status(); };
}

void LiveRun::publish(const live::PoseOutput& pose) {
  outputs_->write(pose);
  latency_.done(pose.stamp, live::host_now());
}

std::string LiveRun::status() const {
  const auto latency = latency_.recent();
  return session_->status() + (latency ? fmt::format(", latency {:.0f} ms (95 %: {:.0f} ms)",
                                                     1e3 * latency->p50_s, 1e3 * latency->p95_s)
                                       : "");
}

void LiveRun::finish() {
  session_->stop();
  eval::Json json = {{"sources", sources_json(session_->sources())}};
  if (const auto late = session_->late(); !late.empty()) json["late_samples"] = late;
  if (const auto latency = latency_.all()) json["latency"] = latency_json(*latency);
  if (recorder_) {
    recorder_->finish();
    json["recording"] = {{"dropped_images", recorder_->dropped_images()},
                         {"complete", !recorder_->failed() && recorder_->dropped_images() == 0}};
    log::info("the recording is in {}", config_.dataset.path);
  }
  eval::merge_metrics(folder_ / "metrics.json", {{"live", json}});
}

}  // namespace apvi::runs
