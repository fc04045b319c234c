// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <CLI/CLI.hpp>

#include "runs/survey/survey_run.hpp"

namespace apvi::cli {

/// Adds the options of the products of surveys to `apvi export`.
void add_survey_options(CLI::App& command, runs::SurveyRequest& request);

/// Runs a request of which only the options were set. Ctrl-C ends it without files that are
/// unfinished.
void export_survey_product(runs::SurveyRequest request);

}  // namespace apvi::cli
