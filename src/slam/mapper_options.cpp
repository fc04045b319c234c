// SPDX-License-Identifier: BSD-3-Clause
#include "slam/mapper_options.hpp"

#include "slam/camera_conversion.hpp"

namespace apvi::slam {
namespace {

MappingThread mapping_thread(localization::RunMode mode) {
  switch (mode) {
    case localization::RunMode::sequential:
      return MappingThread::none;
    case localization::RunMode::replay:
      return MappingThread::blocking;
    case localization::RunMode::realtime:
      return MappingThread::dropping;
  }
  return MappingThread::none;
}

}  // namespace

mapping::TrainerOptions trainer_options(const MappingOptions& options, int seed, const Rig& rig) {
  mapping::TrainerOptions trainer = options.trainer;
  trainer.seed = static_cast<std::uint64_t>(seed);
  if (options.lamp) trainer.lamps = lamps_of(rig);
  return trainer;
}

AsyncMapperOptions async_mapper_options(const Options& options, const Rig& rig) {
  const MappingOptions& mapping = options.mapping;
  const localization::ExecutionOptions& run = options.localization.run;
  return {.thread = mapping_thread(run.mode),
          .threads = run.threads,
          .image_scale = mapping.image_scale,
          .use_dvl_ranges = mapping.use_dvl_ranges,
          .loop_closure = mapping.loop_closure,
          .has_lamp = !lamps_of(rig).empty(),
          .mapper = {.medium = mapping.medium,
                     .trainer = trainer_options(mapping, run.seed, rig),
                     .online = mapping.online,
                     .depth = mapping.depth,
                     .storage_folder = mapping.storage_folder}};
}

}  // namespace apvi::slam
