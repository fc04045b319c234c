// SPDX-License-Identifier: BSD-3-Clause
#pragma once

/// Everything that a program needs to localize and to map: see apvi::slam::System,
/// apvi::localization::System for localization alone, and apvi::slam::Mapper for mapping alone.
#include "apvi/core/error.hpp"
#include "apvi/core/log.hpp"
#include "apvi/io/live_sequence.hpp"
#include "apvi/io/rig_file.hpp"
#include "apvi/io/sequence.hpp"
#include "apvi/io/tum.hpp"
#include "apvi/localization/system.hpp"
#include "apvi/sensors/port.hpp"
#include "apvi/slam/map_snapshot.hpp"
#include "apvi/slam/mapper.hpp"
#include "apvi/slam/system.hpp"
