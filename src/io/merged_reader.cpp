// SPDX-License-Identifier: BSD-3-Clause
#include "io/merged_reader.hpp"

#include <algorithm>
#include <deque>
#include <opencv2/core.hpp>
#include <utility>

#include "apvi/core/error.hpp"
#include "apvi/core/log.hpp"
#include "io/clock_spans.hpp"
#include "io/shifted_source.hpp"

namespace apvi::io {
namespace {

// No sensor begins so long before the IMU, where only their first stamps are known. One that begins
// after it may do so when the clock has been set.
constexpr double kOtherEpoch_s = 86'400.0;

// Samples that are read ahead to see whether a clock was set after the recording began.
constexpr std::size_t kMaxEarly = 20'000;
constexpr std::size_t kMaxEarlyImages = 256;  // a bag holds their bytes

Duration shift_of(const std::string& kind, const ClockShiftConfig& shifts) {
  if (kind == "camera") return Duration::from_seconds(shifts.camera);
  if (kind == "dvl") return Duration::from_seconds(shifts.dvl);
  const bool is_pressure = kind == "pressure" || kind == "depth";
  return is_pressure ? Duration::from_seconds(shifts.pressure) : Duration{0};
}

void shift_clocks(const ClockShiftConfig& shifts, Recording& recording) {
  for (std::size_t i = 0; i < recording.sources.size(); ++i) {
    const Duration shift = shift_of(recording.kinds[i], shifts);
    if (shift == Duration{0}) continue;
    recording.sources[i] = std::make_unique<ShiftedSource>(std::move(recording.sources[i]), shift);
  }
}

}  // namespace

MergedReader::MergedReader(Recording recording, const DatasetConfig& config)
    : recording_(std::move(recording)),
      config_(config),
      clocks_(recording_.kinds, Duration::from_seconds(config.max_time_jump_s)) {
  shift_clocks(config_.clock_shift_s, recording_);
  const auto max_jump = Duration::from_seconds(config_.max_time_jump_s);
  for (std::size_t i = 0; i < recording_.sources.size(); ++i) {
    SampleSource* source = recording_.sources[i].get();
    StreamReport& report = report_[recording_.kinds[i]];
    streams_.push_back({i, source, &report,
                        StreamCleaner(recording_.kinds[i], max_jump, report,
                                      [source] { return source->where(); })});
  }
}

// Reads until the stream has a clean sample ready. False when it is pending or ended.
bool MergedReader::fill(Stream& stream) {
  while (stream.cleaner.ready.empty() && !stream.ended) {
    SensorEvent event;
    const auto drop = [&stream] { stream.cleaner.drop(DropReason::broken_stamp); };
    switch (clocks_.next(stream.index, *stream.source, event, drop)) {
      case SourceState::sample:
        stream.cleaner.push(std::move(event));
        break;
      case SourceState::malformed:
        stream.cleaner.drop_malformed(stream.source->problem());
        break;
      case SourceState::implausible:
        stream.cleaner.drop(DropReason::implausible);
        break;
      case SourceState::pending:
        return false;
      case SourceState::end:
        stream.ended = true;
        stream.cleaner.finish();
        break;
    }
  }
  return !stream.cleaner.ready.empty();
}

MergedReader::Stream* MergedReader::earliest() {
  for (;;) {
    Stream* best = nullptr;
    for (Stream& stream : streams_) {
      if (!fill(stream)) continue;
      const Stamp stamp = stamp_of(stream.cleaner.ready.front());
      if (best == nullptr || stamp < stamp_of(best->cleaner.ready.front())) best = &stream;
    }
    const bool all_ended =
        std::all_of(streams_.begin(), streams_.end(), [](const Stream& s) { return s.ended; });
    // When nothing is ready, retry: a pending source then reads further.
    if (best != nullptr || all_ended) return best;
  }
}

void MergedReader::leave_out(Stream& stream, const std::string& remark) {
  stream.ended = true;
  stream.cleaner.ready.clear();
  clocks_.leave_out(stream.index);
  stream.report->remark = remark;
  log::warning("{}", remark);
}

// A day before the first sample of that of the other sensors which begins last: its clock was set
// before that.
std::optional<Stamp> MergedReader::begin_of_others(const Stream& stream) const {
  std::optional<Stamp> begin;
  for (const Stream& other : streams_) {
    const bool is_reference = recording_.kinds[other.index] == "gnss";
    if (&other == &stream || is_reference || other.cleaner.ready.empty()) continue;
    const Stamp first = stamp_of(other.cleaner.ready.front());
    begin = std::max(begin.value_or(first), first);
  }
  if (!begin) return std::nullopt;
  return *begin - Duration::from_seconds(kOtherEpoch_s);
}

// The first samples of a sensor whose clock was set after the recording began, while those of the
// others were right, belong to no time of the recording.
void MergedReader::drop_before_clock_sets() {
  for (Stream& stream : streams_) fill(stream);
  for (Stream& stream : streams_) {
    const auto begin = begin_of_others(stream);
    if (!begin || stream.cleaner.ready.empty()) continue;
    const Stamp first = stamp_of(stream.cleaner.ready.front());
    if (first >= *begin || !drop_before(stream, *begin)) continue;
    log::warning(
        "{}: its first samples have stamps from {:.3f} s on, long before those of other sensors: "
        "its clock was set before {}; they are dropped",
        recording_.kinds[stream.index], first.seconds(), stream.source->where());
  }
}

// False when the stamps do not come to `begin` soon; nothing is dropped then.
bool MergedReader::drop_before(Stream& stream, Stamp begin) {
  std::deque<SensorEvent> early;
  const bool is_image = std::holds_alternative<ImageFrame>(stream.cleaner.ready.front());
  const std::size_t most = is_image ? kMaxEarlyImages : kMaxEarly;
  SensorEvent event;
  while (early.size() < most) {
    const SourceState state = stream.source->next(event);
    if (state == SourceState::end || state == SourceState::pending) break;
    if (state == SourceState::malformed) stream.cleaner.drop_malformed(stream.source->problem());
    if (state == SourceState::implausible) stream.cleaner.drop(DropReason::implausible);
    if (state != SourceState::sample) continue;
    const bool is_set = stamp_of(event) >= begin;
    early.push_back(std::move(event));
    if (!is_set) continue;
    for (std::size_t i = 1; i < early.size() + stream.cleaner.ready.size(); ++i) {
      stream.cleaner.drop(DropReason::broken_stamp);
    }
    stream.cleaner.restart();
    clocks_.restart(stream.index, std::move(early.back()));
    return true;
  }
  clocks_.put_back(stream.index, std::move(early));
  return false;
}

// A sensor that counts from another epoch than the IMU would only put poses at times without any
// other sensor.
void MergedReader::leave_out_other_clocks(const std::vector<SettledStamps>& settled) {
  const auto imu = std::ranges::find(recording_.kinds, "imu");
  if (imu == recording_.kinds.end()) return;
  const auto index = static_cast<std::size_t>(imu - recording_.kinds.begin());
  const auto imu_span = span_of(settled[index].stamps);
  const bool has_imu = fill(streams_[index]);
  for (Stream& stream : streams_) {
    const std::string& kind = recording_.kinds[stream.index];
    if (stream.index == index || kind == "gnss") continue;
    const auto span = span_of(settled[stream.index].stamps);
    if (span && imu_span) {
      if (are_apart(*span, *imu_span, config_.max_time_jump_s)) {
        leave_out(stream, describe_clocks(kind, *span, *imu_span));
      }
    } else if (has_imu && fill(stream)) {
      const double first_s = stamp_of(stream.cleaner.ready.front()).seconds();
      const double imu_first_s = stamp_of(streams_[index].cleaner.ready.front()).seconds();
      if (first_s < imu_first_s - kOtherEpoch_s) {
        leave_out(stream, describe_clocks(kind, first_s, imu_first_s));
      }
    }
  }
}

void MergedReader::find_start() {
  const std::vector<SettledStamps> settled = settle_time_units(recording_);
  for (const Stream& stream : streams_) {
    if (stream.report->remark.empty()) stream.report->remark = settled[stream.index].remark;
  }
  drop_before_clock_sets();
  leave_out_other_clocks(settled);
  const Stream* first = earliest();
  if (first == nullptr) return;
  begin_ = stamp_of(first->cleaner.ready.front());
  from_ = *begin_ + Duration::from_seconds(config_.start_s);
  if (config_.duration_s > 0.0) until_ = from_ + Duration::from_seconds(config_.duration_s);
}

namespace {

void blacken(ImageFrame& image) {
  image.decode = [decode = std::move(image.decode)] {
    cv::Mat pixels = decode().clone();  // the decoder may share its buffer
    pixels.setTo(cv::Scalar::all(0));
    return pixels;
  };
}

}  // namespace

bool MergedReader::in_blackout(const SensorEvent& event) const {
  if (!std::holds_alternative<ImageFrame>(event)) return false;
  const double t = seconds_between(*begin_, stamp_of(event));
  return std::any_of(config_.blackout_s.begin(), config_.blackout_s.end(),
                     [&](const auto& span) { return t >= span[0] && t < span[1]; });
}

std::optional<SensorEvent> MergedReader::next() {
  if (!begin_) find_start();
  while (!finished_) {
    Stream* stream = earliest();
    if (stream == nullptr) break;
    SensorEvent event = std::move(stream->cleaner.ready.front());
    stream->cleaner.ready.pop_front();
    const Stamp stamp = stamp_of(event);
    if (stamp >= until_) break;
    if (stamp < latest_) {  // only after a pending source
      stream->cleaner.drop(DropReason::out_of_order);
      continue;
    }
    latest_ = stamp;
    if (stamp < from_) continue;
    if (in_blackout(event)) {
      if (config_.blackout_mode == Blackout::dropped) continue;
      blacken(std::get<ImageFrame>(event));
    }
    StreamReport& report = *stream->report;
    if (report.delivered++ == 0 && report.remark.empty()) report.remark = stream->source->remark();
    return event;
  }
  finished_ = true;
  return std::nullopt;
}

double MergedReader::fraction() const {
  if (finished_) return 1.0;
  if (begin_ && until_ != Stamp::max() && latest_ > *begin_) {
    return std::clamp(seconds_between(from_, latest_) / config_.duration_s, 0.0, 1.0);
  }
  double sum = 0.0;
  for (const auto& source : recording_.sources) sum += source->fraction();
  return recording_.sources.empty() ? 1.0 : sum / static_cast<double>(recording_.sources.size());
}

}  // namespace apvi::io
