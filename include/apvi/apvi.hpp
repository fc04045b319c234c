// SPDX-License-Identifier: BSD-3-Clause
#pragma once

/// Everything that a program needs to localize and to map: see apvi::slam::System, and
/// apvi::localization::System for localization alone.
#include "apvi/core/error.hpp"
#include "apvi/core/log.hpp"
#include "apvi/io/live_sequence.hpp"
#include "apvi/io/rig_file.hpp"
#include "apvi/io/sequence.hpp"
#include "apvi/io/tum.hpp"
#include "apvi/localization/system.hpp"
#include "apvi/slam/system.hpp"
