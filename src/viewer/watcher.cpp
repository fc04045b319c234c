// SPDX-License-Identifier: BSD-3-Clause
#include "viewer/watcher.hpp"

#include <algorithm>
#include <cmath>

namespace apvi::viewer {
namespace {

using std::chrono::milliseconds;

constexpr std::size_t kMaxFlights = 2;   // frames that are not drawn yet
constexpr std::size_t kMaxRequests = 8;  // snapshots and measurements
constexpr milliseconds kAtRest(150);     // after the last change of a moving view
constexpr milliseconds kRenewal(500);    // of a view at rest while the map changes
constexpr double kDetailAtRest_px = 1.0;
constexpr double kDetailMoving_px = 2.0;

int scaled(int size, double scale) {
  return std::max(1, static_cast<int>(std::lround(size * scale)));
}

template <class... F>
struct Overloaded : F... {
  using F::operator()...;
};
template <class... F>
Overloaded(F...) -> Overloaded<F...>;

}  // namespace

void Watcher::receive(const Message& message, Time now) {
  const auto request = [this](const Job& job) {
    if (requests_.size() < kMaxRequests) requests_.push_back(job);
  };
  std::visit(Overloaded{[&](const ViewMessage& m) {
                          view_ = m;
                          view_time_ = now;
                          view_is_new_ = true;
                        },
                        [&](const DrawnMessage& m) { drawn(m.frame, now); },
                        [&](const SnapshotMessage& m) { request(m); },
                        [&](const MeasureMessage& m) { request(m); }, [](const PauseMessage&) {},
                        [](const SaveMessage&) {}},
             message);
}

std::optional<bool> Watcher::due(Time now, std::uint64_t version) const {
  if (!view_ || flights_.size() >= kMaxFlights) return std::nullopt;
  if (view_is_new_) return !view_->moving;
  if (needs_complete_) {
    if (now - view_time_ >= kAtRest) return true;
    return std::nullopt;
  }
  if (version != drawn_version_ && now - drawn_time_ >= kRenewal) return true;
  return std::nullopt;
}

FrameJob Watcher::make_frame(bool complete) const {
  FrameJob job{
      .frame = next_frame_, .view_id = view_->id, .view = view_->view, .complete = complete};
  job.view.detail_px = complete ? kDetailAtRest_px : kDetailMoving_px;
  if (complete) return job;
  Viewpoint& v = job.view.viewpoint;
  const double scale = rate_.scale();
  job.complete = false;
  v.width = scaled(v.width, scale);
  v.height = scaled(v.height, scale);
  return job;
}

std::optional<Job> Watcher::next(Time now, std::uint64_t version) {
  if (!requests_.empty()) {
    const Job job = requests_.front();
    requests_.pop_front();
    return job;
  }
  const std::optional<bool> complete = due(now, version);
  if (!complete) return std::nullopt;
  const FrameJob job = make_frame(*complete);
  ++next_frame_;
  flights_.push_back({.frame = job.frame, .counts = !*complete, .sent = now});
  view_is_new_ = false;
  needs_complete_ = !job.complete;
  drawn_version_ = version;
  drawn_time_ = now;
  return job;
}

void Watcher::sent(std::uint32_t frame, double render_s, std::size_t bytes, Time now) {
  for (Flight& f : flights_) {
    if (f.frame != frame) continue;
    f.render_s = render_s;
    f.bytes = bytes;
    f.sent = now;
  }
}

void Watcher::skipped(std::uint32_t frame) {
  std::erase_if(flights_, [frame](const Flight& f) { return f.frame == frame; });
}

void Watcher::written(std::uint32_t frame) {
  for (Flight& f : flights_) f.written |= f.frame == frame;
}

void Watcher::drawn(std::uint32_t frame, Time now) {
  const auto flight = std::ranges::find_if(
      flights_, [frame](const Flight& f) { return f.frame == frame && f.written; });
  if (flight == flights_.end()) return;
  const double link_s = std::chrono::duration<double>(now - flight->sent).count();
  if (flight->counts) rate_.add(flight->render_s, link_s, flight->bytes);
  flights_.erase(flight);
}

}  // namespace apvi::viewer
