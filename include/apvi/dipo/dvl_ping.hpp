// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "apvi/dipo/measurements.hpp"
#include "apvi/sensors/rig.hpp"
#include "apvi/sensors/samples.hpp"

namespace apvi::dipo {

int valid_beams(const DvlSample& ping);
/// Whether `b` repeats `a`: telemetry sends each ping several times under new stamps.
bool same_ping(const DvlSample& a, const DvlSample& b);
/// Whether anything in the ping measures a velocity: bottom lock, or with `use_beams` single beams
/// that are in lock while too few are for a velocity. A negative altitude means no bottom at all.
bool is_usable(const DvlSample& ping, bool use_beams);

/// What four beams in lock contradict each other by [m/s]: they measure three unknowns, and the
/// rest is noise or an outlier. Zero with fewer beams.
double beam_disagreement(const DvlSample& ping, const DvlCalibration& dvl);

/// The ping as one measurement, by beams in lock (`by_beam`) or as a velocity, each component or
/// beam with `variance` [m²/s²], the second-order noise of the time offset included. The state of
/// `filter` is that at the ping's stamp minus `offset_s`.
Measurement ping_measurement(const Eskf& filter, const Kinematics& k, const imu::World& world,
                             const DvlCalibration& dvl, const DvlSample& ping, bool by_beam,
                             double variance, double offset_s);

}  // namespace apvi::dipo
