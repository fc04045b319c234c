// SPDX-License-Identifier: BSD-3-Clause
#include "apvi/vio/tracker.hpp"

#include <algorithm>
#include <utility>

#include "apvi/core/error.hpp"
#include "vio/corner_grid.hpp"
#include "vio/frame_image.hpp"
#include "vio/optical_flow.hpp"
#include "vio/projection.hpp"
#include "vio/rigidity_check.hpp"
#include "vio/stereo_search.hpp"

namespace apvi::vio {
namespace {

using Eigen::Quaterniond;
using Eigen::Vector2d;

constexpr double kMinContrast = 1.0;  // below, an image shows nothing [grey values]
constexpr double kMemory_s = 0.3;     // so long after the last good frame its tracks are looked for
constexpr int kMemoryFrames = 2;      // or so many bad frames after it, if that is longer
constexpr int kGlitchTracks = 20;     // of so many tracks
constexpr double kGlitchShare = 0.1;  // less than this found again: something covers the view

struct StereoView {
  StereoMatch match;
  Vector2d velocity = Vector2d::Zero();  // of the point [1/s]
  int length = 1;
  Stamp stamp;
};

struct Track {
  std::int64_t id = 0;
  int length = 1;
  cv::Point2f pixel;
  Vector2d point = Vector2d::Zero();
  Vector2d velocity = Vector2d::Zero();  // of the point [1/s]
  cv::Point2f drift;                     // motion that the rotation does not explain [px/s]
  std::optional<StereoView> right;
};

cv::Size size_of(const CameraModel& camera) {
  return {camera.parameters().width, camera.parameters().height};
}

std::vector<cv::Point2f> pixels_of(const std::vector<Track>& tracks) {
  std::vector<cv::Point2f> pixels;
  pixels.reserve(tracks.size());
  for (const Track& track : tracks) pixels.push_back(track.pixel);
  return pixels;
}

std::vector<TrackPoint> points_of(const std::vector<Track>& tracks) {
  std::vector<TrackPoint> points;
  points.reserve(tracks.size());
  for (const Track& track : tracks) points.push_back({track.id, track.point});
  return points;
}

Observation observe(const Track& track) {
  const Vector2d pixel(track.pixel.x, track.pixel.y);
  return {track.id, 0, pixel, track.point, track.velocity, track.length};
}

Observation observe_right(const Track& track) {
  const StereoMatch& match = track.right->match;
  const Vector2d pixel(match.pixel.x, match.pixel.y);
  return {track.id, 1, pixel, match.point, track.right->velocity, track.right->length};
}

}  // namespace

struct Tracker::Impl {
  Impl(const TrackerConfig& tracker_config, const std::vector<CameraCalibration>& cameras)
      : config(tracker_config),
        camera(cameras.front()),
        preparer(config.equalize),
        grid(size_of(camera.model), config.max_tracks, config.min_distance_px),
        rigidity(config.max_epipolar_px / focal_length(camera.model)) {
    if (cameras.size() < 2) return;
    right_size = size_of(cameras[1].model);
    stereo.emplace(camera, cameras[1], config.max_backward_px, config.max_epipolar_px);
  }

  TrackedFrame process(const std::vector<cv::Mat>& images, Stamp stamp,
                       const std::optional<Quaterniond>& R_before_now);
  FrameQuality take_image(const std::vector<cv::Mat>& images, Stamp stamp);
  void add_rotation(const std::optional<Quaterniond>& R_before_now);
  bool remembers(Stamp stamp) const;
  TrackedFrame bad(TrackedFrame frame);
  void forget();
  bool glitch(std::size_t found, Stamp stamp) const;
  void keep(Stamp stamp);
  std::optional<Quaterniond> rotation_since_last() const;
  std::vector<cv::Point2f> turned_pixels() const;
  std::vector<Track> followed(double dt, FrameStatistics& statistics) const;
  std::vector<Track> rigid(const std::vector<Track>& now, FrameStatistics& statistics);
  void detect(FrameStatistics& statistics);
  void look_right(const std::vector<cv::Mat>& images, Stamp stamp);
  void report(TrackedFrame& frame) const;

  TrackerConfig config;
  CameraCalibration camera;
  FramePreparer preparer;
  CornerGrid grid;
  RigidityCheck rigidity;
  std::optional<StereoSearch> stereo;
  cv::Size right_size;

  std::vector<Track> tracks;  // as of the last good frame, by id
  std::int64_t next_id = 0;
  FrameImage last;  // the last good frame
  FrameImage current;
  FrameImage right;
  std::optional<Stamp> last_stamp;                                  // of the last good frame
  std::optional<Stamp> newest;                                      // of all frames
  int bad_frames = 0;                                               // since the last good one
  std::optional<Quaterniond> R_last_now = Quaterniond::Identity();  // since the last good frame
};

FrameQuality Tracker::Impl::take_image(const std::vector<cv::Mat>& images, Stamp stamp) {
  current.brightness = 0.0;  // until an image says otherwise
  if (newest && stamp < *newest) return FrameQuality::out_of_order;
  if (newest && stamp == *newest) return FrameQuality::repeated;
  newest = stamp;
  if (images.empty() || !FramePreparer::take(images[0], size_of(camera.model), current)) {
    return FrameQuality::wrong_size;
  }
  if (current.contrast < kMinContrast) return FrameQuality::featureless;
  if (last_stamp && identical(current.grey, last.grey)) return FrameQuality::repeated;
  return FrameQuality::good;
}

void Tracker::Impl::add_rotation(const std::optional<Quaterniond>& R_before_now) {
  if (R_last_now && R_before_now && R_before_now->coeffs().allFinite()) {
    R_last_now = (*R_last_now * *R_before_now).normalized();
  } else {
    R_last_now.reset();
  }
}

// Whether tracks of the last good frame may still be found in this one.
bool Tracker::Impl::remembers(Stamp stamp) const {
  return bad_frames <= kMemoryFrames || seconds_between(*last_stamp, stamp) <= kMemory_s;
}

// Of the camera since the last good frame.
std::optional<Quaterniond> Tracker::Impl::rotation_since_last() const {
  if (!R_last_now) return std::nullopt;
  const Quaterniond& R_body_camera = camera.T_body_camera.rotation;
  return R_body_camera.conjugate() * R_last_now->conjugate() * R_body_camera;
}

// Where the tracks would be now if the camera had only turned.
std::vector<cv::Point2f> Tracker::Impl::turned_pixels() const {
  std::vector<cv::Point2f> pixels = pixels_of(tracks);
  const std::optional<Quaterniond> R = rotation_since_last();
  if (!R) return pixels;
  for (std::size_t i = 0; i < tracks.size(); ++i) {
    const auto pixel = camera.model.project(*R * tracks[i].point.homogeneous());
    if (pixel) pixels[i] = to_cv(*pixel);
  }
  return pixels;
}

std::vector<Track> Tracker::Impl::followed(double dt, FrameStatistics& statistics) const {
  const std::vector<cv::Point2f> turned = turned_pixels();
  std::vector<cv::Point2f> guess = turned;
  for (std::size_t i = 0; i < tracks.size(); ++i) {
    guess[i] += static_cast<float>(dt) * tracks[i].drift;
  }
  const Flow flow = follow(last, current, pixels_of(tracks), guess, turned, config.max_backward_px);
  std::vector<Track> now;
  for (std::size_t i = 0; i < tracks.size(); ++i) {
    if (!flow.found[i]) continue;
    const auto point = plane_point(camera.model, flow.to[i]);
    if (!point) continue;
    Track track = tracks[i];
    ++track.length;
    track.velocity = (*point - track.point) / dt;
    track.drift = (flow.to[i] - turned[i]) / dt;
    track.pixel = flow.to[i];
    track.point = *point;
    now.push_back(track);
  }
  statistics.lost_flow = static_cast<int>(tracks.size() - now.size());
  return now;
}

std::vector<Track> Tracker::Impl::rigid(const std::vector<Track>& now,
                                        FrameStatistics& statistics) {
  const std::vector<char> stays = rigidity.check(points_of(now), rotation_since_last());
  std::vector<Track> kept;
  for (std::size_t i = 0; i < now.size(); ++i) {
    if (stays[i] != 0) kept.push_back(now[i]);
  }
  statistics.lost_epipolar = static_cast<int>(now.size() - kept.size());
  return kept;
}

void Tracker::Impl::detect(FrameStatistics& statistics) {
  for (const cv::Point2f& pixel : grid.find(current.half_gradient(), pixels_of(tracks))) {
    const auto point = plane_point(camera.model, pixel);
    if (!point) continue;
    Track track;
    track.id = next_id++;
    track.pixel = pixel;
    track.point = *point;
    tracks.push_back(track);
    ++statistics.detected;
  }
}

void Tracker::Impl::look_right(const std::vector<cv::Mat>& images, Stamp stamp) {
  if (!stereo || images.size() < 2) return;
  if (!FramePreparer::take(images[1], right_size, right)) return;
  preparer.build_pyramid(right);
  std::vector<StereoQuery> queries;
  for (const Track& track : tracks) {
    queries.push_back({track.pixel, track.point, std::nullopt});
    if (track.right) queries.back().inverse_depth = track.right->match.inverse_depth;
  }
  const auto matches = stereo->find(current, right, queries);
  for (std::size_t i = 0; i < tracks.size(); ++i) {
    if (!matches[i]) continue;
    StereoView view{*matches[i], Vector2d::Zero(), 1, stamp};
    if (const auto& before = tracks[i].right) {
      view.length = before->length + 1;
      view.velocity =
          (view.match.point - before->match.point) / seconds_between(before->stamp, stamp);
    }
    tracks[i].right = view;
  }
}

void Tracker::Impl::report(TrackedFrame& frame) const {
  for (const Track& track : tracks) frame.observations.push_back(observe(track));
  for (const Track& track : tracks) {
    if (track.right && track.right->stamp == frame.stamp) {
      frame.observations.push_back(observe_right(track));
    }
  }
  frame.statistics.stable =
      static_cast<int>(std::count_if(tracks.begin(), tracks.end(), [&](const Track& track) {
        return track.length >= config.stable_frames;
      }));
  frame.statistics.spread = spread(pixels_of(tracks), size_of(camera.model));
}

// A frame that cannot be used: the last good one stays what the next is compared with.
TrackedFrame Tracker::Impl::bad(TrackedFrame frame) {
  const FrameQuality quality = frame.statistics.quality;
  if (quality == FrameQuality::wrong_size || quality == FrameQuality::featureless) ++bad_frames;
  if (last_stamp && !remembers(frame.stamp)) forget();
  return frame;
}

void Tracker::Impl::forget() {
  tracks.clear();
  rigidity.clear();
  last_stamp.reset();
}

// Whether hardly anything was found again, though the frame before is recent enough.
bool Tracker::Impl::glitch(std::size_t found, Stamp stamp) const {
  const auto tracked = static_cast<double>(tracks.size());
  return tracks.size() >= kGlitchTracks && static_cast<double>(found) < kGlitchShare * tracked &&
         bad_frames < kMemoryFrames && remembers(stamp);
}

TrackedFrame Tracker::Impl::process(const std::vector<cv::Mat>& images, Stamp stamp,
                                    const std::optional<Quaterniond>& R_before_now) {
  TrackedFrame frame{stamp, {}, {}};
  FrameStatistics& statistics = frame.statistics;
  if (!newest || *newest < stamp) add_rotation(R_before_now);
  statistics.quality = take_image(images, stamp);
  statistics.brightness = current.brightness;
  if (statistics.quality != FrameQuality::good) return bad(std::move(frame));
  preparer.build_pyramid(current);
  if (last_stamp && !tracks.empty()) {
    const double dt = seconds_between(*last_stamp, stamp);
    std::vector<Track> now = rigid(followed(dt, statistics), statistics);
    if (glitch(now.size(), stamp)) {
      statistics.quality = FrameQuality::featureless;
      return bad(std::move(frame));
    }
    statistics.tracked = static_cast<int>(now.size());
    tracks = std::move(now);
  }
  detect(statistics);
  look_right(images, stamp);
  report(frame);
  keep(stamp);
  return frame;
}

// The present frame becomes the last good one.
void Tracker::Impl::keep(Stamp stamp) {
  rigidity.add(points_of(tracks));
  std::swap(last, current);
  last_stamp = stamp;
  bad_frames = 0;
  R_last_now = Quaterniond::Identity();
}

Tracker::Tracker(const TrackerConfig& config, const std::vector<CameraCalibration>& cameras) {
  APVI_CHECK(!cameras.empty());
  impl_ = std::make_unique<Impl>(config, cameras);
}

Tracker::~Tracker() = default;
Tracker::Tracker(Tracker&&) noexcept = default;
Tracker& Tracker::operator=(Tracker&&) noexcept = default;

TrackedFrame Tracker::process(const std::vector<cv::Mat>& images, Stamp stamp,
                              const std::optional<Quaterniond>& R_before_now) {
  return impl_->process(images, stamp, R_before_now);
}

void Tracker::reset() {
  impl_->forget();
  impl_->newest.reset();
  impl_->bad_frames = 0;
  impl_->R_last_now = Quaterniond::Identity();
}

}  // namespace apvi::vio
