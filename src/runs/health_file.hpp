// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "apvi/core/stamp.hpp"
#include "fusion/degeneracy.hpp"

namespace apvi::runs {

/// The columns of a line of health.csv that calibration and the viewer use.
struct HealthRow {
  Stamp stamp;
  std::string state;                ///< fusion::FusionState
  std::string level;                ///< step of Algorithm 1 that rejected VIO, or "accepted"
  std::string vio;                  ///< vio::Status
  int landmarks = 0;                ///< in the solution
  fusion::Eigenvalues eigenvalues;  ///< as tested; zero without a solution
};

/// Finds columns by name. Throws InputError with file and line for an invalid number.
std::vector<HealthRow> read_health(const std::filesystem::path& file);

}  // namespace apvi::runs
