// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "apvi/core/stamp.hpp"
#include "apvi/fusion/degeneracy.hpp"

namespace apvi::pipeline {

/// A line of a run's health.csv, as far as calibration needs it.
struct HealthLine {
  Stamp stamp;
  std::string level;                ///< step of Algorithm 1 that turned VIO down, or "accepted"
  std::string vio;                  ///< vio::Status
  int landmarks = 0;                ///< in the solution
  fusion::Eigenvalues eigenvalues;  ///< as tested; zero without a solution
};

/// Columns are found by name. Throws InputError with file and line for what is no number.
std::vector<HealthLine> read_health(const std::filesystem::path& file);

}  // namespace apvi::pipeline
