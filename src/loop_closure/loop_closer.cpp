// SPDX-License-Identifier: BSD-3-Clause
#include "loop_closure/loop_closer.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "apvi/core/constants.hpp"
#include "apvi/core/log.hpp"
#include "apvi/geometry/so3.hpp"
#include "core/stopwatch.hpp"
#include "loop_closure/bundle_views.hpp"
#include "loop_closure/loop_measurement.hpp"

namespace apvi::loop_closure {
namespace {

constexpr double kKnownLoopSigmas = 2.0;  // a loop with a smaller error adds nothing to the map
constexpr double kOptimizationPeriod_s = 4.0;  // for 500 loops, and as much longer for more
constexpr double kLoopsPerPeriod = 500.0;
// Sum of EdgeCheck::news of the loops since the last optimization: their graph has moved.
constexpr double kNews = 1.0;
constexpr double kVerticalDriftRatio = 0.25;  // relative to horizontal drift: pressure bounds it

// Plausibility limits from the drift of DVL odometry; larger errors indicate a similar but
// different place.
constexpr double kMaxTilt = 3.0 * kRadiansPerDegree;
constexpr double kMaxHeading = 20.0 * kRadiansPerDegree;
constexpr double kMaxVertical_m = 0.5;
constexpr double kMaxHorizontal_m = 0.5;
constexpr double kMaxPathFraction = 0.05;

// Smaller corrections move no pixel and are not reported.
constexpr double kMinReportedShift_m = 1e-3;
constexpr double kMinReportedTurn = 2e-4;

}  // namespace

CloserOptions closer_options(const LoopOptions& options) {
  const PlaceOptions& places = options;
  const double horizontal = options.drift_m_sqrt_s;
  const double heading = kRadiansPerDegree * options.drift_deg_sqrt_s;
  const double vertical = kVerticalDriftRatio * horizontal;
  return {.places = places,
          .graph = {},
          .min_news_sigmas = kKnownLoopSigmas,
          .lists_corrections = true,
          .drift_per_s =
              DriftVariance{heading * heading, horizontal * horizontal, vertical * vertical}};
}

CloserOptions closer_options(const SmoothingOptions& options) {
  const PlaceOptions& places = options;
  return {.places = places,
          .graph = {.node_step_s = options.node_step_s,
                    .max_nodes = static_cast<std::size_t>(options.max_nodes)},
          .gate = options.gate,
          .drift_factor = options.drift_factor,
          .adjusts_bundle = options.bundle_adjustment};
}

LoopCloser::LoopCloser(const CloserOptions& options, const CameraModel& camera)
    : options_(options),
      graph_(options.graph),
      places_(options.places, camera, options.mask),
      camera_(camera) {
  if (options.known_map) anchors_.emplace(options.known_map, options.gate);
}

bool LoopCloser::is_plausible(const Loop& loop) const {
  const SE3 predicted = graph_.corrected_pose(loop.to);
  const SE3 found = graph_.corrected_pose(loop.from) * loop.T_from_to;
  const Eigen::Vector3d offset = found.translation - predicted.translation;
  const Eigen::Quaterniond turned = found.rotation * predicted.rotation.conjugate();
  const double tilt = std::acos(std::min(1.0, (turned * Eigen::Vector3d::UnitZ()).z()));
  const double path = graph_.path_m(loop.from, loop.to);
  return tilt < kMaxTilt && std::abs(so3::yaw(turned)) < kMaxHeading &&
         std::abs(offset.z()) < kMaxVertical_m &&
         offset.head<2>().norm() < kMaxHorizontal_m + kMaxPathFraction * path;
}

// Nothing if the graph rejects the loop.
std::optional<LoopCloser::Found> LoopCloser::accepted(const Loop& loop) const {
  if (std::isinf(options_.gate)) {
    const bool adds = graph_.residual_norm(loop) > options_.min_news_sigmas;
    return Found{.loop = loop, .news = adds ? std::numeric_limits<double>::infinity() : 0.0};
  }
  const EdgeCheck check = graph_.check(loop);
  if (!(check.squared_distance < options_.gate)) return std::nullopt;
  return Found{.loop = loop, .news = check.news};
}

// A loop with an earlier place that the graph accepts.
std::optional<LoopCloser::Found> LoopCloser::find_loop(const PlaceStore::Stored& stored,
                                                       const Place& place) {
  const double ray_sigma = places_.ray_sigma();
  const auto match = recognize_place(stored.place, place, ray_sigma, options_.places.min_inliers);
  if (!match) return std::nullopt;
  const std::size_t newest = graph_.newest();
  std::optional<Found> found;
  if (const auto loop = measure_loop(graph_, stored.keyframe, newest, *match, ray_sigma);
      loop && is_plausible({stored.keyframe, newest, match->T_now_then.inverse()})) {
    found = accepted(*loop);
  }
  found ? ++closures_ : ++rejected_;
  log::debug("loop: keyframe {} matches {}, {:.1f} s ago: {} of {} points are inliers{}",
             graph_[newest].stamp.ns, graph_[stored.keyframe].stamp.ns,
             graph_.age_s(stored.keyframe), match->inliers, match->matches,
             found ? "" : ": rejected");
  return found;
}

// Searches for loops with earlier places. All of a keyframe are checked with the same state of the
// graph.
void LoopCloser::detect_loops(const Place& place) {
  std::vector<Found> all;
  // After a break no pose relates the places before it to this one.
  const std::size_t first = search_ ? search_->first() : 0;
  for (const PlaceStore::Stored* stored : places_.candidates(graph_, first)) {
    if (const auto found = find_loop(*stored, place)) all.push_back(*found);
  }
  for (const Found& found : all) {
    news_ += found.news;
    graph_.add(found.loop);
  }
}

// Limits the rate of optimizations, so that their work per second has a bound.
bool LoopCloser::is_optimization_due() const {
  if (!last_optimization_) return true;
  const double loops = static_cast<double>(graph_.edges());
  return seconds_between(*last_optimization_, graph_[graph_.newest()].stamp) >=
         kOptimizationPeriod_s * std::max(1.0, loops / kLoopsPerPeriod);
}

KeyframeCorrections LoopCloser::changed_corrections() {
  KeyframeCorrections all;
  for (std::size_t i = 0; i < graph_.size(); ++i) {
    const SE3 now = correction(i);
    SE3& reported = reported_[i];
    const SE3 before = reported * graph_[i].T_world_camera;
    const SE3 T_after_before = now * reported.inverse();
    const double moved = (T_after_before * before.translation - before.translation).norm();
    const double turned = so3::angle_between(now.rotation, reported.rotation);
    const bool newest = i == graph_.newest();
    if (moved < kMinReportedShift_m && turned < kMinReportedTurn && !newest) continue;
    reported = now;
    all.push_back({graph_[i].stamp, T_after_before});
  }
  return all;
}

bool LoopCloser::add(Keyframe keyframe, const cv::Mat& gray) {
  if (graph_.size() > 0) {
    const Stamp before = graph_[graph_.newest()].stamp;
    if (keyframe.stamp <= before) return false;
    if (options_.drift_per_s) {
      keyframe.drift = *options_.drift_per_s * seconds_between(before, keyframe.stamp);
    }
  }
  graph_.add(keyframe);
  reported_.push_back(reported_.empty() ? SE3::identity() : reported_.back());
  if (graph_.is_break(graph_.newest())) begin_search();
  const bool new_place = !gray.empty() && places_.is_new_place(graph_);
  searched_ = new_place || (!gray.empty() && (anchors_ || search_));
  was_found_ = false;
  if (!searched_) return false;
  search(gray, new_place);
  return (was_found_ || is_optimization_due()) && flush();
}

void LoopCloser::search(const cv::Mat& gray, bool new_place) {
  Place place = new_place ? places_.describe(graph_, gray) : places_.features(gray);
  if (search_) {
    reconnect(place);
  } else if (anchors_) {
    anchor_to_map(place);
  }
  if (!new_place) return;
  detect_loops(place);
  places_.store(graph_, std::move(place));
}

void LoopCloser::anchor_to_map(const Place& place) {
  const bool searching = anchors_->is_searching();
  if (anchors_->process(place, graph_)) news_ = std::numeric_limits<double>::infinity();
  was_found_ = searching && !anchors_->is_searching();
}

// Without a place since the break before, this one is the same loss of odometry, which goes on.
void LoopCloser::begin_search() {
  if (search_ && !places_.has_path()) return search_->begin_at(graph_.newest());
  ++breaks_;
  log::info("odometry is lost; the vehicle is searched among the places seen before");
  places_.end_path(graph_);
  search_.emplace(places_, graph_, graph_.newest(), camera_, options_.places.pixel_sigma);
}

// What was seen since the break moves as a whole; the graph does the rest.
void LoopCloser::reconnect(const Place& place) {
  const auto found = search_->add(place, graph_);
  if (!found) return;
  graph_.place_since(search_->first(), found->T_map_odometry);
  for (const Loop& loop : found->loops) graph_.add(loop);
  closures_ += found->loops.size();
  log::info(
      "the path after a break is found again after {:.1f} s: {} images agree, by {} points of "
      "earlier ones",
      graph_.age_s(search_->first()), found->loops.size(), found->points);
  ++reconnections_;
  search_.reset();
  news_ = std::numeric_limits<double>::infinity();
  was_found_ = true;
}

std::vector<ClosedLoop> LoopCloser::loops(std::size_t first) const {
  std::vector<ClosedLoop> all;
  for (std::size_t i = first; i < graph_.loops().size(); ++i) {
    const Loop& loop = graph_.loops()[i];
    all.push_back({graph_[loop.from].stamp, graph_[loop.to].stamp});
  }
  return all;
}

SE3 LoopCloser::newest_correction() const {
  const std::size_t newest = graph_.newest();
  const SE3 T_odometry_body =
      graph_[newest].T_world_camera * graph_[newest].T_body_camera.inverse();
  return graph_.T_world_known().inverse() * corrected_pose(newest) *
         T_body_camera(newest).inverse() * T_odometry_body.inverse();
}

SE3 LoopCloser::correction(std::size_t keyframe) const {
  return graph_.T_world_known().inverse() * corrected_pose(keyframe) *
         graph_[keyframe].T_world_camera.inverse();
}

PlaceMap LoopCloser::place_map() const {
  const SE3 T_known_world = graph_.T_world_known().inverse();
  std::vector<PosedPlace> posed;
  for (const PlaceStore::Stored* stored : places_.all()) {
    posed.push_back({graph_[stored->keyframe].stamp,
                     T_known_world * corrected_pose(stored->keyframe), &stored->place});
  }
  return make_place_map(posed, places_.ray_sigma());
}

bool LoopCloser::flush() {
  if (news_ < kNews) return false;
  last_optimization_ = graph_[graph_.newest()].stamp;
  news_ = 0.0;
  graph_.optimize();
  return true;
}

bool LoopCloser::finish() {
  const bool changed = flush();
  if (std::isinf(options_.gate)) return changed;
  return graph_.refine() || changed;
}

// Moves the keyframes of the places, and those between them.
bool LoopCloser::adjust(const std::function<void(int iteration)>& progress) {
  if (!options_.adjusts_bundle) return false;
  const std::vector<const PlaceStore::Stored*> places = places_.all();
  if (places.size() < 2) return false;
  log::info("bundle adjustment of {} images", places.size());
  const Stopwatch watch;
  const auto result = adjust_bundle(bundle_views(graph_, places, options_.drift_factor), camera_,
                                    {.ray_sigma = places_.ray_sigma(),
                                     .T_body_camera = graph_[graph_.newest()].T_body_camera,
                                     .prior = options_.camera_prior,
                                     .progress = progress});
  if (!result) {
    log::info("bundle adjustment: left out, too few features join the images");
    return false;
  }
  for (std::size_t k = 0; k < places.size(); ++k) {
    const std::size_t keyframe = places[k]->keyframe;
    shifts_.add(keyframe, graph_.corrected_pose(keyframe),
                result->T_world_body[k] * result->camera.T_body_camera);
  }
  adjusted_ = result->camera;
  const double pixel = places_.ray_sigma() / options_.places.pixel_sigma;
  log::info("bundle adjustment: {} rays to {} points, {:.2f} px off, {:.2f} px before; {:.1f} s",
            result->rays, result->points, result->rms_after / pixel, result->rms_before / pixel,
            watch.seconds());
  return true;
}

}  // namespace apvi::loop_closure
