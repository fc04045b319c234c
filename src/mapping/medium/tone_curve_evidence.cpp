// SPDX-License-Identifier: BSD-3-Clause
#include "mapping/medium/tone_curve_evidence.hpp"

#include <torch/torch.h>

#include <cmath>

#include "gaussians/model/archive.hpp"

namespace apvi::mapping {
namespace {

constexpr double kForgetting = 0.8;  // as for the medium
// Model errors alone favored the linear curve by up to 21 where the camera was not linear, and a
// linear camera was told by 88 to 1,600 (simulated seabed by day and with a lamp).
constexpr double kLinearMargin = 50.0;
constexpr double kDecided = 500.0;

std::optional<gaussians::ToneCurve> given_curve(const ToneCurveOptions& options) {
  switch (options.kind) {
    case ToneCurveKind::linear:
      return gaussians::ToneCurve{};
    case ToneCurveKind::srgb:
      return gaussians::kSrgb;
    case ToneCurveKind::power:
      return gaussians::ToneCurve{.gamma = options.gamma};
    case ToneCurveKind::estimated:
      break;
  }
  return std::nullopt;
}

}  // namespace

ToneCurveEvidence::ToneCurveEvidence(ToneCurveOptions options) : given_(given_curve(options)) {}

void ToneCurveEvidence::add(double linear_deviance, double power_deviance) {
  for_linear_ = kForgetting * for_linear_ + power_deviance - linear_deviance;
}

bool ToneCurveEvidence::is_decided() const {
  return given_.has_value() || std::abs(for_linear_ - kLinearMargin) > kDecided;
}

gaussians::ToneCurve ToneCurveEvidence::initial() const {
  return given_.value_or(gaussians::ToneCurve{});
}

gaussians::ToneCurve ToneCurveEvidence::choice() const {
  if (given_) return *given_;
  return for_linear_ > kLinearMargin ? gaussians::ToneCurve{} : kViewingCurve;
}

void ToneCurveEvidence::save(torch::serialize::OutputArchive& archive) const {
  archive.write("for_linear", torch::IValue(for_linear_));
}

void ToneCurveEvidence::load(torch::serialize::InputArchive& archive) {
  for_linear_ = gaussians::read_double(archive, "for_linear");
}

}  // namespace apvi::mapping
