// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cmath>
#include <memory>
#include <optional>
#include <string>
#include <utility>

#include "io/sample_source.hpp"

namespace apvi::io {

/// The samples of a sensor whose clock differs from that of the others by a known time. Samples
/// whose stamps would lie before zero are malformed.
class ShiftedSource : public SampleSource {
 public:
  ShiftedSource(std::unique_ptr<SampleSource> samples, Duration shift)
      : samples_(std::move(samples)), shift_(shift) {}

  SourceState next(SensorEvent& event) override {
    const SourceState state = samples_->next(event);
    before_zero_ = false;
    if (state != SourceState::sample) return state;
    std::visit([this](auto& sample) { sample.stamp = sample.stamp + shift_; }, event);
    before_zero_ = stamp_of(event).ns < 0;
    return before_zero_ ? SourceState::malformed : state;
  }
  std::string where() const override { return samples_->where(); }
  std::pair<std::string, std::string> problem() const override {
    if (before_zero_) return {"the stamp is before zero with dataset.clock_shift_s", ""};
    return samples_->problem();
  }
  double fraction() const override { return samples_->fraction(); }
  std::string remark() const override { return samples_->remark(); }
  std::optional<StampSummary> stamp_summary() override {
    auto summary = samples_->stamp_summary();
    if (!summary) return std::nullopt;
    const double shift = shift_.seconds() * std::pow(10.0, 9 - summary->power);
    summary->first += shift;
    summary->last += shift;
    return summary;
  }
  void set_stamp_power(int power) override { samples_->set_stamp_power(power); }

 private:
  std::unique_ptr<SampleSource> samples_;
  Duration shift_;
  bool before_zero_ = false;
};

}  // namespace apvi::io
