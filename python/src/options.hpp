// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "runs/run_config.hpp"

namespace apvi::python {

/// The configuration of a run.
struct Options {
  runs::RunConfig config;
};

}  // namespace apvi::python
