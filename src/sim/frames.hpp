// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>

#include "core/interrupt.hpp"
#include "sim/dataset_writer.hpp"

namespace apvi::sim {

/// Renders the frames whose files do not exist yet, and the ground truth of every
/// `truth.image_every`-th frame of cam0. Image files are written atomically, after their ground
/// truth. Returns early, with frames missing, when the user interrupts.
void render_frames(const std::filesystem::path& root, OutputFormat format, const Scene& scene,
                   const EventSchedule& events, const Recording& recording,
                   const TriangleMesh& mesh, const RayCaster& world, int threads,
                   const InterruptGuard& interrupt);

}  // namespace apvi::sim
