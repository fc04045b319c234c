// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "apvi/sensors/rig.hpp"
#include "apvi/sensors/samples.hpp"
#include "dipo/measurements.hpp"

namespace apvi::dipo {

int valid_beams(const DvlSample& ping);
/// True if `b` is a repetition of `a`: some telemetry links send each ping several times with new
/// stamps.
bool same_ping(const DvlSample& a, const DvlSample& b);
/// True if the ping measures any velocity: it has bottom lock or, with `use_beams`, single beams in
/// lock although too few for a full velocity. A negative altitude means no bottom return.
bool is_usable(const DvlSample& ping, bool use_beams);

/// Parity residual of four beams in lock [m/s]: four beams measure three unknowns, so the residual
/// is noise or an outlier. Zero with fewer beams.
double beam_disagreement(const DvlSample& ping, const DvlCalibration& dvl);

/// The ping as one measurement, either of the beams in lock (`by_beam`) or of the velocity.
/// `variance` [m²/s²] applies to each component or beam; the second-order noise of the time offset
/// is added. `filter` must hold the state at the ping's stamp minus `offset_s`.
Measurement ping_measurement(const Eskf& filter, const Kinematics& k, const imu::EarthModel& world,
                             const DvlCalibration& dvl, const DvlSample& ping, bool by_beam,
                             double variance, double offset_s);

}  // namespace apvi::dipo
