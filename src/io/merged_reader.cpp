// SPDX-License-Identifier: BSD-3-Clause
#include "io/merged_reader.hpp"

#include <algorithm>
#include <opencv2/core.hpp>
#include <utility>

#include "apvi/core/error.hpp"
#include "apvi/core/log.hpp"

namespace apvi::io {

MergedReader::MergedReader(Recording recording, const DatasetConfig& config)
    : recording_(std::move(recording)),
      config_(config),
      clocks_(recording_.kinds, Duration::from_seconds(config.max_time_jump_s)) {
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

void MergedReader::find_start() {
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
    ++stream->report->delivered;
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
