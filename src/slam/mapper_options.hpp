// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "apvi/sensors/rig.hpp"
#include "apvi/slam/options.hpp"
#include "slam/async_mapper.hpp"

namespace apvi::slam {

/// The trainer's options, with the rig's lamp if it is to be modeled.
mapping::TrainerOptions trainer_options(const MappingOptions& options, int seed, const Rig& rig);

/// What the mapper of `options` is told, on the thread that the run mode asks for.
AsyncMapperOptions async_mapper_options(const Options& options, const Rig& rig);

}  // namespace apvi::slam
