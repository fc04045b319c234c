// SPDX-License-Identifier: BSD-3-Clause
#include "runs/maps/online_map.hpp"

#include <fmt/format.h>
#include <torch/torch.h>

#include <algorithm>
#include <future>

#include "apvi/core/error.hpp"
#include "apvi/core/log.hpp"
#include "apvi/io/tum.hpp"
#include "gaussians/device.hpp"
#include "runs/dive_files.hpp"
#include "slam/mapper_options.hpp"

namespace apvi::runs {
namespace {

// Saves take at most about a twentieth of the time.
constexpr double kSaveIntervalOverDuration = 20.0;

slam::AsyncMapperOptions mapper_options(const RunConfig& config, const MappingRunOptions& options,
                                        const Rig& rig) {
  slam::Options all = slam_options(config);
  all.mapping.storage_folder = options.folder / kStorageFolder;
  return slam::async_mapper_options(all, rig);
}

}  // namespace

OnlineMap::OnlineMap(const RunConfig& config, const MappingRunOptions& options, const Rig& rig)
    : config_(config),
      options_(options),
      mapper_(mapper_options(config, options, rig), rig,
              {.interrupted = options.interrupted,
               .progress = [this] { write_periodic_output(); },
               .final_progress = [this](const auto& progress) { show(progress); },
               .failed = [this] { report_failure(); }}) {}

void OnlineMap::open_files() {
  log_.emplace(options_.folder / "mapping.csv", config_.mapping.report_every_s, options_.resume);
  watch_.reset();
}

void OnlineMap::write_periodic_output() {
  save_if_asked();
  const mapping::Mapper& mapper = mapper_.mapper();
  if (log_->due(watch_.seconds()) && mapper.size() > 0) {
    const mapping::Map whole = mapper.stored() > 0 ? mapper.snapshot() : mapper.map();
    log_->write(watch_.seconds(), mapper.iteration(), whole, mapper.keyframes());
  }
  const double every = config_.mapping.checkpoint_every_s;
  const double interval = std::max(every, kSaveIntervalOverDuration * last_save_s_);
  if (every <= 0.0 || since_save_.seconds() < interval) return;
  save_map();
  since_save_.reset();
}

void OnlineMap::show(const slam::FinalProgress& progress) {
  save_if_asked();
  if (progress.ended) return status_.reset();
  const bool refining = progress.work == slam::FinalWork::refining;
  if (!status_) status_.emplace(refining ? "refining" : "finishing the map");
  const mapping::Mapper& mapper = mapper_.mapper();
  status_->update(progress.fraction,
                  refining ? fmt::format("iteration {}, {} Gaussians, loss {:.4f}",
                                         mapper.iteration(), mapper.size(), progress.loss)
                           : mapper_.status());
}

// The two large files are written at the same time.
void OnlineMap::save_map() {
  const Stopwatch watch;
  const mapping::Mapper& mapper = mapper_.mapper();
  if (mapper.size() > 0) {
    auto checkpoint =
        std::async(std::launch::async, [&] { mapper.save(options_.folder / kCheckpointFile); });
    write_map(options_.folder, mapper.snapshot(torch::kCPU));
    checkpoint.get();
  }
  last_save_s_ = watch.seconds();
  saving_s_ += last_save_s_;
  answer_save(mapper.size() > 0 ? "" : "there is no map yet");
}

// A failure is told to whoever asked; it is no reason to end the map.
void OnlineMap::save_if_asked() {
  if (!save_asked_) return;
  try {
    save_map();
    since_save_.reset();
  } catch (const std::exception& error) {
    const std::string text = error.what();
    log::warning("the map was not saved: {}", text);
    answer_save(text.substr(0, text.find('\n')));
  }
}

void OnlineMap::answer_save(const std::string& error) {
  if (save_asked_.exchange(false) && options_.observer != nullptr) {
    options_.observer->map_saved(error);
  }
}

void OnlineMap::save() {
  save_map();
  if (mapper_.mapper().size() > 0) {
    io::write_tum(options_.folder / "keyframes.tum", mapper_.keyframes());
  }
  // With a pose graph of localization the file is there, with the loops before the map too.
  const std::filesystem::path loops = options_.folder / kLoopsFile;
  if (!mapper_.loops().empty() && !std::filesystem::exists(loops)) {
    write_loops(loops, mapper_.loops());
  }
  if (log_) log_->close();
}

// While the run goes on, keyframes.tum is that of localization.
void OnlineMap::report_failure() {
  save_or_log([this] { save_map(); });
  try {
    rethrow_failure();
  } catch (const std::exception& error) {
    log::error("mapping disabled: {}; localization continues", error.what());
  }
}

// LibTorch's own messages are long.
void OnlineMap::rethrow_failure() const {
  if (!mapper_.failure()) return;
  try {
    std::rethrow_exception(mapper_.failure());
  } catch (const c10::Error& error) {
    if (gaussians::is_out_of_memory(error)) fail_out_of_memory(config_, options_.folder);
    fail_run("mapping: {}", error.what_without_backtrace());
  }
}

std::map<std::string, double> OnlineMap::times() const {
  std::map<std::string, double> all = mapper_.times();
  all["saving"] = saving_s_;
  return all;
}

}  // namespace apvi::runs
