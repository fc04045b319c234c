// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>
#include <vector>

#include "core/interrupt.hpp"
#include "sim/spectral/development.hpp"
#include "sim/writers/dataset_writer.hpp"

namespace apvi::sim {

/// Exposure and white balance of the frames of cam0, in order, as its firmware would report them;
/// empty with paper physics.
using Exposures = std::vector<Development>;

/// Renders the frames whose files do not exist yet, and the ground truth of every
/// `truth.image_every`-th frame of cam0. Image files are written atomically, after their ground
/// truth. Returns early, with frames missing, when the user interrupts.
Exposures render_frames(const std::filesystem::path& root, OutputFormat format, const Scene& scene,
                        const EventSchedule& events, const Recording& recording,
                        const TriangleMesh& mesh, const RayCaster& world, int threads,
                        const InterruptGuard& interrupt);

}  // namespace apvi::sim
