// SPDX-License-Identifier: BSD-3-Clause
#include "io/folder/waterlinked_log.hpp"

#include <algorithm>
#include <utility>

#include "apvi/core/log.hpp"
#include "io/folder/csv_file.hpp"
#include "io/folder/waterlinked_report.hpp"

namespace apvi::io {
namespace {

class WaterLinkedLog : public SampleSource {
 public:
  WaterLinkedLog(std::unique_ptr<std::istream> in, std::string name, std::uint64_t size)
      : in_(std::move(in)), name_(std::move(name)), size_(size) {}

  SourceState next(SensorEvent& event) override {
    problem_ = {};
    while (std::getline(*in_, line_)) {
      ++line_number_;
      bytes_read_ += line_.size() + 1;
      const WaterLinkedReport report = parse_waterlinked(line_);
      if (!report.problem.empty()) return refuse(report.problem);
      if (!report.sample) continue;
      if (report.water_track && !std::exchange(reported_water_, true)) {
        log::warning("{}: water track: velocities against the water are not used", where());
      }
      event = *report.sample;
      return SourceState::sample;
    }
    return SourceState::end;
  }
  std::string where() const override { return fmt::format("{}:{}", name_, line_number_); }
  std::pair<std::string, std::string> problem() const override { return problem_; }
  double fraction() const override {
    if (in_->eof()) return 1.0;
    if (size_ == 0) return 0.0;
    return std::min(1.0, static_cast<double>(bytes_read_) / static_cast<double>(size_));
  }

 private:
  SourceState refuse(std::string kind) {
    constexpr std::size_t kMaxShown = 80;
    problem_ = {std::move(kind), line_.substr(0, kMaxShown)};
    for (char& c : problem_.second) c = static_cast<unsigned char>(c) < ' ' ? '?' : c;
    return SourceState::malformed;
  }

  std::unique_ptr<std::istream> in_;
  std::string name_;
  std::uint64_t size_;
  std::uint64_t bytes_read_ = 0;
  std::size_t line_number_ = 0;
  std::string line_;
  std::pair<std::string, std::string> problem_;
  bool reported_water_ = false;
};

}  // namespace

std::unique_ptr<SampleSource> waterlinked_dvl(const std::filesystem::path& path) {
  std::error_code unknown;  // a pipe has no size
  const auto size = std::filesystem::file_size(path, unknown);
  return waterlinked_dvl(open_text(path), path.string(), unknown ? 0 : size);
}

std::unique_ptr<SampleSource> waterlinked_dvl(std::unique_ptr<std::istream> in, std::string name,
                                              std::uint64_t size) {
  return std::make_unique<WaterLinkedLog>(std::move(in), std::move(name), size);
}

}  // namespace apvi::io
