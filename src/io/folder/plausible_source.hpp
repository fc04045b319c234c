// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <memory>
#include <string>
#include <utility>

#include "io/folder/pressure_unit.hpp"
#include "io/sample_source.hpp"

namespace apvi::io {

/// Leaves out the pressures that are apart from the rest of the recording.
class PlausibleSource : public SampleSource {
 public:
  PlausibleSource(std::unique_ptr<SampleSource> rows, std::shared_ptr<const PressureScale> scale)
      : rows_(std::move(rows)), scale_(std::move(scale)) {}

  SourceState next(SensorEvent& event) override {
    const SourceState state = rows_->next(event);
    const bool plausible = state != SourceState::sample ||
                           scale_->is_plausible(std::get<PressureSample>(event).pressure_pa);
    return plausible ? state : SourceState::implausible;
  }
  std::string where() const override { return rows_->where(); }
  std::pair<std::string, std::string> problem() const override { return rows_->problem(); }
  double fraction() const override { return rows_->fraction(); }
  std::string remark() const override { return scale_->doubt; }
  std::optional<StampSummary> stamp_summary() override { return rows_->stamp_summary(); }
  void set_stamp_power(int power) override { rows_->set_stamp_power(power); }

 private:
  std::unique_ptr<SampleSource> rows_;
  std::shared_ptr<const PressureScale> scale_;
};

}  // namespace apvi::io
