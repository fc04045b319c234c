// SPDX-License-Identifier: BSD-3-Clause
#include "apvi/core/error.hpp"
#include "fuzz/fuzz_target.hpp"
#include "importer/telemetry.hpp"

// A GPMF payload, twice in a row, and as the camera's settings.

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace apvi;
  const importer::Bytes bytes(data, size);
  importer::parse_gpmf_settings(bytes);
  const importer::GpmfPayload payload = importer::parse_gpmf(bytes);
  for (const importer::GpmfStream& stream : payload.streams) {
    fuzz::check(stream.size() * stream.channels <= stream.values.size(), "samples without values");
  }
  const importer::Telemetry telemetry =
      importer::join_telemetry({{payload, 0.0, 1.0}, {payload, 1.0, 1.0}});
  for (const importer::ImuRow& row : telemetry.imu) {
    fuzz::check(row.gyro.allFinite() && row.accel.allFinite(), "an IMU sample is not finite");
  }
  return 0;
}
