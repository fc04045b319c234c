// SPDX-License-Identifier: BSD-3-Clause
#include "io/folder/pressure_unit.hpp"

#include <cmath>

#include "apvi/core/log.hpp"
#include "core/text.hpp"

namespace apvi::io {
namespace {

PressureUnit guess_unit(double value, std::string_view source) {
  if (value >= 50000.0) return PressureUnit::pa;
  const bool hpa = value >= 500.0;
  log::info("{}: first pressure is {:.6g}, assuming {}; otherwise set dataset.pressure_unit",
            source, value, hpa ? "hPa" : "kPa");
  return hpa ? PressureUnit::hpa : PressureUnit::kpa;
}

}  // namespace

std::optional<PressureUnit> pressure_unit_of(std::string_view word) {
  const std::string unit = text::to_lower(word);
  if (unit == "pa") return PressureUnit::pa;
  if (unit == "hpa" || unit == "mbar") return PressureUnit::hpa;
  if (unit == "kpa") return PressureUnit::kpa;
  return std::nullopt;
}

double PressureScale::to_pascal(double value, std::string_view source) {
  if (!std::isfinite(value)) return value;
  if (unit_ == PressureUnit::automatic) unit_ = guess_unit(value, source);
  if (unit_ == PressureUnit::hpa) return value * 1e2;
  if (unit_ == PressureUnit::kpa) return value * 1e3;
  return value;
}

}  // namespace apvi::io
