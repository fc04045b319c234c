// SPDX-License-Identifier: BSD-3-Clause
#include "vio/frontend/tracker.hpp"

#include <algorithm>
#include <utility>

#include "apvi/core/error.hpp"
#include "sensors/camera_mask.hpp"
#include "sensors/reduced_camera.hpp"
#include "vio/factors/projection.hpp"
#include "vio/frontend/corner_grid.hpp"
#include "vio/frontend/frame_image.hpp"
#include "vio/frontend/optical_flow.hpp"
#include "vio/frontend/rigidity_check.hpp"
#include "vio/frontend/stereo_search.hpp"

namespace apvi::vio {
namespace {

using Eigen::Quaterniond;
using Eigen::Vector2d;

constexpr double kMinContrast = 1.0;  // minimum standard deviation of a usable image [gray values]
constexpr double kMaxResumeGap_s = 0.3;  // after the last good frame
constexpr int kMaxResumeFrames = 2;      // or this many bad frames, if that is longer
constexpr int kGlitchTracks = 20;        // minimum number of tracks for the glitch test
constexpr double kGlitchFraction = 0.1;  // glitch: a smaller fraction of tracks is found again

struct StereoView {
  StereoMatch match;
  int length = 1;
  Stamp stamp;
};

struct Track {
  std::int64_t id = 0;
  int length = 1;
  Stamp since;
  cv::Point2f pixel;
  Vector2d point = Vector2d::Zero();
  cv::Point2f drift;  // flow not explained by the rotation [px/s]
  std::optional<StereoView> right;
};

cv::Size size_of(const CameraModel& camera) {
  return {camera.parameters().width, camera.parameters().height};
}

// A camera, and its images as they are tracked.
struct TrackedCamera {
  TrackedCamera(const CameraCalibration& recorded, int max_image_side_px)
      : size(size_of(recorded.model)),
        by(reduction_of(recorded.model, max_image_side_px)),
        calibration(recorded) {
    calibration.model = reduced(recorded.model, by);
    scene = reduced_mask(recorded.mask, by, 0);
    patches = reduced_mask(recorded.mask, by, kFlowWindow / 2);
  }
  Vector2d recorded_pixel(const cv::Point2f& pixel) const {
    return by * (Vector2d(pixel.x, pixel.y).array() + 0.5) - 0.5;
  }

  cv::Size size;  // of recorded images
  int by;         // which they are divided
  CameraCalibration calibration;
  cv::Mat scene;    // mask of tracked images
  cv::Mat patches;  // mask of the centers of patches that show nothing hidden
};

double corner_distance_of(const TrackerConfig& config, cv::Size image) {
  return config.min_distance_px.value_or(corner_distance(image, config.max_tracks));
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

FeatureObservation observe(const Track& track, const TrackedCamera& camera) {
  return {track.id, 0, camera.recorded_pixel(track.pixel), track.point, track.length};
}

FeatureObservation observe_right(const Track& track, const TrackedCamera& camera) {
  const StereoMatch& match = track.right->match;
  return {track.id, 1, camera.recorded_pixel(match.pixel), match.point, track.right->length};
}

}  // namespace

struct Tracker::Impl {
  Impl(const TrackerConfig& tracker_config, const std::vector<CameraCalibration>& cameras)
      : config(tracker_config),
        left(cameras.front(), config.max_image_side_px),
        camera(left.calibration),
        preparer(config.equalize),
        grid(size_of(camera.model), config.max_tracks,
             corner_distance_of(config, size_of(camera.model)), left.patches),
        rigidity(config.max_epipolar_px / focal_length(camera.model)) {
    if (cameras.size() < 2) return;
    second.emplace(cameras[1], config.max_image_side_px);
    stereo.emplace(camera, second->calibration, config.max_forward_backward_px,
                   config.max_epipolar_px);
  }

  TrackedFrame process(const std::vector<cv::Mat>& images, Stamp stamp,
                       const std::optional<Quaterniond>& R_before_now);
  FrameQuality load_image(const std::vector<cv::Mat>& images, Stamp stamp);
  void add_rotation(const std::optional<Quaterniond>& R_before_now);
  bool can_resume(Stamp stamp) const;
  TrackedFrame handle_bad_frame(TrackedFrame frame);
  void clear_tracks();
  bool is_glitch(std::size_t found, Stamp stamp) const;
  void keep(Stamp stamp);
  std::optional<Quaterniond> rotation_since_last() const;
  std::vector<cv::Point2f> rotated_pixels() const;
  std::vector<Track> track_by_flow(double dt, FrameStatistics& statistics) const;
  std::vector<Track> reject_non_rigid(Stamp stamp, const std::vector<Track>& now,
                                      FrameStatistics& statistics);
  void detect(Stamp stamp, FrameStatistics& statistics);
  void match_stereo(const std::vector<cv::Mat>& images, Stamp stamp);
  bool is_stable(const Track& track, Stamp now) const;
  void report(TrackedFrame& frame) const;

  TrackerConfig config;
  TrackedCamera left;
  CameraCalibration camera;  // of tracked images
  FramePreparer preparer;
  CornerGrid grid;
  RigidityCheck rigidity;
  std::optional<StereoSearch> stereo;
  std::optional<TrackedCamera> second;

  std::vector<Track> tracks;  // of the last good frame, by id
  std::int64_t next_id = 0;
  FrameImage last;  // the last good frame
  FrameImage current;
  FrameImage right;
  std::optional<Stamp> last_stamp;                                  // of the last good frame
  std::optional<Stamp> newest;                                      // of all frames
  int bad_frames = 0;                                               // since the last good one
  std::optional<Quaterniond> R_last_now = Quaterniond::Identity();  // since the last good frame
};

FrameQuality Tracker::Impl::load_image(const std::vector<cv::Mat>& images, Stamp stamp) {
  current.brightness = 0.0;  // until an image is loaded
  if (newest && stamp < *newest) return FrameQuality::out_of_order;
  if (newest && stamp == *newest) return FrameQuality::repeated;
  newest = stamp;
  if (images.empty() || !FramePreparer::load(images[0], left.size, current, left.by, left.scene)) {
    return FrameQuality::wrong_size;
  }
  if (current.contrast < kMinContrast) return FrameQuality::featureless;
  if (last_stamp && identical(current.gray, last.gray)) return FrameQuality::repeated;
  return FrameQuality::good;
}

void Tracker::Impl::add_rotation(const std::optional<Quaterniond>& R_before_now) {
  if (R_last_now && R_before_now && R_before_now->coeffs().allFinite()) {
    R_last_now = (*R_last_now * *R_before_now).normalized();
  } else {
    R_last_now.reset();
  }
}

// True if tracks of the last good frame may be resumed in this one.
bool Tracker::Impl::can_resume(Stamp stamp) const {
  return bad_frames <= kMaxResumeFrames || seconds_between(*last_stamp, stamp) <= kMaxResumeGap_s;
}

// Rotation of the camera since the last good frame.
std::optional<Quaterniond> Tracker::Impl::rotation_since_last() const {
  if (!R_last_now) return std::nullopt;
  const Quaterniond& R_body_camera = camera.T_body_camera.rotation;
  return R_body_camera.conjugate() * R_last_now->conjugate() * R_body_camera;
}

// Positions of the tracks predicted from the rotation alone.
std::vector<cv::Point2f> Tracker::Impl::rotated_pixels() const {
  std::vector<cv::Point2f> pixels = pixels_of(tracks);
  const std::optional<Quaterniond> R = rotation_since_last();
  if (!R) return pixels;
  for (std::size_t i = 0; i < tracks.size(); ++i) {
    const auto pixel = camera.model.project(*R * tracks[i].point.homogeneous());
    if (pixel) pixels[i] = to_cv(*pixel);
  }
  return pixels;
}

std::vector<Track> Tracker::Impl::track_by_flow(double dt, FrameStatistics& statistics) const {
  const std::vector<cv::Point2f> rotated = rotated_pixels();
  std::vector<cv::Point2f> guess = rotated;
  for (std::size_t i = 0; i < tracks.size(); ++i) {
    guess[i] += static_cast<float>(dt) * tracks[i].drift;
  }
  const Flow flow = compute_flow(last, current, pixels_of(tracks), guess, rotated,
                                 config.max_forward_backward_px);
  std::vector<Track> now;
  for (std::size_t i = 0; i < tracks.size(); ++i) {
    if (!flow.found[i] || is_hidden(left.patches, flow.to[i])) continue;
    const auto point = plane_point(camera.model, flow.to[i]);
    if (!point) continue;
    Track track = tracks[i];
    ++track.length;
    track.drift = (flow.to[i] - rotated[i]) / dt;
    track.pixel = flow.to[i];
    track.point = *point;
    now.push_back(track);
  }
  statistics.lost_flow = static_cast<int>(tracks.size() - now.size());
  return now;
}

std::vector<Track> Tracker::Impl::reject_non_rigid(Stamp stamp, const std::vector<Track>& now,
                                                   FrameStatistics& statistics) {
  const std::vector<char> is_inlier = rigidity.check(stamp, points_of(now), rotation_since_last());
  std::vector<Track> kept;
  for (std::size_t i = 0; i < now.size(); ++i) {
    if (is_inlier[i] != 0) kept.push_back(now[i]);
  }
  statistics.lost_epipolar = static_cast<int>(now.size() - kept.size());
  return kept;
}

void Tracker::Impl::detect(Stamp stamp, FrameStatistics& statistics) {
  for (const cv::Point2f& pixel : grid.find(current.half_gradient(), pixels_of(tracks))) {
    const auto point = plane_point(camera.model, pixel);
    if (!point) continue;
    Track track;
    track.id = next_id++;
    track.since = stamp;
    track.pixel = pixel;
    track.point = *point;
    tracks.push_back(track);
    ++statistics.detected;
  }
}

void Tracker::Impl::match_stereo(const std::vector<cv::Mat>& images, Stamp stamp) {
  if (!stereo || images.size() < 2) return;
  if (!FramePreparer::load(images[1], second->size, right, second->by)) return;
  preparer.build_pyramid(right);
  std::vector<StereoQuery> queries;
  for (const Track& track : tracks) {
    queries.push_back({track.pixel, track.point, std::nullopt});
    if (track.right) queries.back().inverse_depth = track.right->match.inverse_depth;
  }
  const auto matches = stereo->find(current, right, queries);
  for (std::size_t i = 0; i < tracks.size(); ++i) {
    if (!matches[i] || is_hidden(second->patches, matches[i]->pixel)) continue;
    const int before = tracks[i].right ? tracks[i].right->length : 0;
    tracks[i].right = StereoView{*matches[i], before + 1, stamp};
  }
}

bool Tracker::Impl::is_stable(const Track& track, Stamp now) const {
  return track.length >= config.stable_frames &&
         seconds_between(track.since, now) >= config.stable_s;
}

void Tracker::Impl::report(TrackedFrame& frame) const {
  for (const Track& track : tracks) frame.observations.push_back(observe(track, left));
  for (const Track& track : tracks) {
    if (track.right && track.right->stamp == frame.stamp) {
      frame.observations.push_back(observe_right(track, *second));
    }
  }
  frame.statistics.stable =
      static_cast<int>(std::count_if(tracks.begin(), tracks.end(), [&](const Track& track) {
        return is_stable(track, frame.stamp);
      }));
  frame.statistics.spread = spread(pixels_of(tracks), size_of(camera.model));
}

// Handles an unusable frame: the last good frame remains the reference.
TrackedFrame Tracker::Impl::handle_bad_frame(TrackedFrame frame) {
  const FrameQuality quality = frame.statistics.quality;
  if (quality == FrameQuality::wrong_size || quality == FrameQuality::featureless) ++bad_frames;
  if (last_stamp && !can_resume(frame.stamp)) clear_tracks();
  return frame;
}

void Tracker::Impl::clear_tracks() {
  tracks.clear();
  rigidity.clear();
  last_stamp.reset();
}

// True if hardly any track was found although the last good frame is recent.
bool Tracker::Impl::is_glitch(std::size_t found, Stamp stamp) const {
  const auto tracked = static_cast<double>(tracks.size());
  return tracks.size() >= kGlitchTracks && static_cast<double>(found) < kGlitchFraction * tracked &&
         bad_frames < kMaxResumeFrames && can_resume(stamp);
}

TrackedFrame Tracker::Impl::process(const std::vector<cv::Mat>& images, Stamp stamp,
                                    const std::optional<Quaterniond>& R_before_now) {
  TrackedFrame frame{stamp, {}, {}};
  FrameStatistics& statistics = frame.statistics;
  if (!newest || *newest < stamp) add_rotation(R_before_now);
  statistics.quality = load_image(images, stamp);
  statistics.brightness = current.brightness;
  if (statistics.quality != FrameQuality::good) return handle_bad_frame(std::move(frame));
  preparer.build_pyramid(current);
  if (last_stamp && !tracks.empty()) {
    const double dt = seconds_between(*last_stamp, stamp);
    std::vector<Track> now = reject_non_rigid(stamp, track_by_flow(dt, statistics), statistics);
    if (is_glitch(now.size(), stamp)) {
      statistics.quality = FrameQuality::featureless;
      return handle_bad_frame(std::move(frame));
    }
    statistics.tracked = static_cast<int>(now.size());
    tracks = std::move(now);
  }
  detect(stamp, statistics);
  match_stereo(images, stamp);
  report(frame);
  keep(stamp);
  return frame;
}

// The current frame becomes the last good one.
void Tracker::Impl::keep(Stamp stamp) {
  rigidity.add(stamp, points_of(tracks));
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
  impl_->clear_tracks();
  impl_->newest.reset();
  impl_->bad_frames = 0;
  impl_->R_last_now = Quaterniond::Identity();
}

}  // namespace apvi::vio
