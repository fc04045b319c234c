// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>

#include "apvi/core/interrupt.hpp"
#include "apvi/sim/dataset_writer.hpp"

namespace apvi::sim {

/// Renders the frames that are not there yet, and the truth of every `truth.image_every`-th of
/// cam0. A frame's file appears complete or not at all, after its truth. Returns early, with frames
/// missing, when the user interrupts.
void render_frames(const std::filesystem::path& root, OutputFormat format, const Scene& scene,
                   const EventSchedule& events, const Recording& recording,
                   const TriangleMesh& mesh, const RayCaster& world, int threads,
                   const InterruptGuard& interrupt);

}  // namespace apvi::sim
