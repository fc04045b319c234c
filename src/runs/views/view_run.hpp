// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>

#include "viewer/server.hpp"

namespace apvi::runs {

/// Serves the viewer's page for a run folder or a map file until `interrupted`. Throws InputError
/// for invalid input, RunError when the port is taken.
void view_run(const std::filesystem::path& source, const viewer::ServerOptions& options,
              const std::function<bool()>& interrupted);

/// Writes a page that shows the map without a server: in SH degree 0, without the lamp, and in less
/// detail when the map has more Gaussians than `max_gaussians`. Throws InputError, RunError.
void export_view(const std::filesystem::path& source, const std::filesystem::path& file,
                 std::int64_t max_gaussians);

}  // namespace apvi::runs
