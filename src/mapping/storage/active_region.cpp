// SPDX-License-Identifier: BSD-3-Clause
#include "mapping/storage/active_region.hpp"

#include <torch/torch.h>

#include <algorithm>
#include <cmath>
#include <iterator>
#include <string>

#include "apvi/core/log.hpp"
#include "gaussians/device.hpp"
#include "gaussians/host_values.hpp"
#include "gaussians/model/archive.hpp"
#include "gaussians/model/rows.hpp"
#include "mapping/density/seeds.hpp"

namespace apvi::mapping {
namespace {

using gaussians::may_see;
using gaussians::Sphere;
using gaussians::to_camera;
using gaussians::to_world;
using torch::Tensor;

// Fractions of the device's limit: above the first, Gaussians are stored until the second is left.
constexpr double kFull = 0.9;
constexpr double kKept = 0.7;
// Parts are loaded when the camera may see them within this margin, and stored only outside of the
// larger one, as fractions of the usual distance of the scene.
constexpr double kLoadMargin = 0.3;
constexpr double kStoreMargin = 0.8;
// Distance up to which a camera sees, over that of its own Gaussians, or the usual one if it has
// none.
constexpr double kFarOverOwn = 1.5;
constexpr double kFarOverUsual = 3.0;
// Radius of the sphere of a part over the root mean square distance from its center.
constexpr double kRadiusOverRms = 1.6;
// A keyframe is paused when more than this fraction of the Gaussians in its view is stored.
constexpr double kMaxMissing = 0.01;
// Keyframes until it is looked for distant parts again when there were few.
constexpr std::size_t kPatience = 10;
// Less than this fraction of the limit is not worth the time that it takes to store or to swap it.
constexpr double kSwapped = 0.05;
// Gaussians that are projected to find out what a keyframe sees: every n-th.
constexpr std::int64_t kProjected = 50000;
// Fraction of the memory for stored parts that is left when some were written to files.
constexpr double kLeftInMemory = 0.8;
// Gaussians that are read at a time for a copy of the whole map.
constexpr std::int64_t kReadAtOnce = 500000;

/// The Gaussians on the device of a keyframe: their number and the sphere around most of them.
struct DevicePart {
  double count = 0.0;
  Sphere in_world;
};

std::vector<DevicePart> device_parts(const MapOptimizer& optimizer, std::size_t keyframes) {
  const auto n = static_cast<std::int64_t>(keyframes);
  const Tensor anchored = (optimizer.anchors() >= 0).nonzero().squeeze(1);
  const Tensor anchors = optimizer.anchors().index_select(0, anchored);
  const Tensor means = optimizer.map().means.index_select(0, anchored).to(torch::kFloat64);
  const Tensor columns =
      torch::cat({torch::ones_like(means.slice(1, 0, 1)), means, means.square().sum(1, true)}, 1);
  const Tensor sums =
      torch::zeros({n, 5}, columns.options()).index_add_(0, anchors, columns).to(torch::kCPU);
  const auto sum = sums.accessor<double, 2>();
  std::vector<DevicePart> parts(keyframes);
  for (std::int64_t i = 0; i < n; ++i) {
    DevicePart& part = parts[static_cast<std::size_t>(i)];
    part.count = sum[i][0];
    if (part.count == 0.0) continue;
    double variance = sum[i][4] / part.count;
    for (std::size_t k = 0; k < 3; ++k) {
      part.in_world.center[k] = sum[i][static_cast<std::int64_t>(k) + 1] / part.count;
      variance -= part.in_world.center[k] * part.in_world.center[k];
    }
    part.in_world.radius_m = kRadiusOverRms * std::sqrt(std::max(0.0, variance));
  }
  return parts;
}

/// Marks the Gaussians of these keyframes [n] bool.
Tensor belongs_to(const Tensor& anchors, const std::vector<std::int64_t>& keyframes,
                  std::size_t count) {
  Tensor chosen = torch::zeros({static_cast<std::int64_t>(count) + 1}, torch::kBool);
  for (const std::int64_t keyframe : keyframes) chosen[keyframe] = true;
  return chosen.to(anchors.device())
      .index_select(0, torch::where(anchors < 0, static_cast<std::int64_t>(count), anchors));
}

Sphere inflated(Sphere sphere, double by_m) {
  sphere.radius_m += by_m;
  return sphere;
}

}  // namespace

/// A keyframe with Gaussians, seen from the camera.
struct ActiveRegion::Place {
  std::int64_t anchor = 0;
  Sphere in_camera;
  double distance_m = 0.0;  ///< of its center from the middle of what the camera sees
};

void ActiveRegion::follow(std::size_t view, double range_m, KeyframeStore& keyframes,
                          MapOptimizer& optimizer, OnlineTraining& training) {
  if (max_stored_bytes_ > 0.0) {
    center_on(view, range_m, /*fill=*/false, keyframes, optimizer, training);
  }
}

void ActiveRegion::revisit(std::size_t view, double range_m, KeyframeStore& keyframes,
                           MapOptimizer& optimizer, OnlineTraining& training) {
  center_on(view, range_m, /*fill=*/true, keyframes, optimizer, training);
}

void ActiveRegion::center_on(std::size_t view, double range_m, bool fill, KeyframeStore& keyframes,
                             MapOptimizer& optimizer, OnlineTraining& training) {
  const torch::NoGradGuard no_grad;
  const double missing = load_near(view, range_m, fill, keyframes, optimizer);
  const bool must_swap = missing > kSwapped * optimizer.max_gaussians();
  if (must_swap) look_again_ = 0;
  store_far(view, range_m, keyframes, optimizer);
  if (must_swap) load_near(view, range_m, fill, keyframes, optimizer);
  pause(keyframes, training);
}

void ActiveRegion::load_all(KeyframeStore& keyframes, MapOptimizer& optimizer,
                            OnlineTraining& training) {
  load(storage_.anchors(), keyframes, optimizer);
  pause(keyframes, training);
}

// In the order of distance.
std::vector<ActiveRegion::Place> ActiveRegion::places(const std::vector<std::int64_t>& anchors,
                                                      std::size_t view, double range_m,
                                                      const KeyframeStore& keyframes) const {
  std::vector<Place> out;
  for (const std::int64_t anchor : anchors) {
    const Tensor& T_own = keyframes[static_cast<std::size_t>(anchor)].T_camera_world;
    const Sphere here =
        to_camera(keyframes[view].T_camera_world, to_world(T_own, spheres_.at(anchor)));
    const auto& [x, y, z] = here.center;
    out.push_back({anchor, here, std::hypot(x, y, z - range_m)});
  }
  std::sort(out.begin(), out.end(),
            [](const Place& a, const Place& b) { return a.distance_m < b.distance_m; });
  return out;
}

double ActiveRegion::far_m(std::size_t view, double range_m) const {
  const auto found = spheres_.find(static_cast<std::int64_t>(view));
  if (found == spheres_.end()) return kFarOverUsual * range_m;
  const auto& [x, y, z] = found->second.center;
  return kFarOverOwn * (std::hypot(x, y, z) + found->second.radius_m);
}

// Returns the number of Gaussians that the camera may see and for which there is no room.
double ActiveRegion::load_near(std::size_t view, double range_m, bool fill,
                               const KeyframeStore& keyframes, MapOptimizer& optimizer) {
  const double most = optimizer.max_gaussians();
  const std::vector<Place> stored = places(storage_.anchors(), view, range_m, keyframes);
  const auto is_within = [&](const Place& place, double margin) {
    return may_see(keyframes[view].intrinsics, inflated(place.in_camera, margin * range_m),
                   kFarOverUsual * range_m);
  };
  const bool is_due = fill || std::any_of(stored.begin(), stored.end(), [&](const Place& place) {
                        return is_within(place, kLoadMargin);
                      });
  if (!is_due) return 0.0;
  auto size = static_cast<double>(optimizer.size());
  double missing = 0.0;
  std::vector<std::int64_t> chosen;
  for (const Place& place : stored) {
    const bool is_near = is_within(place, kLoadMargin);
    // More than is needed now, so that not every keyframe loads something.
    if (!is_near && !fill && !is_within(place, kStoreMargin)) continue;
    const auto count = static_cast<double>(storage_.size(place.anchor));
    if (size + count <= (is_near ? most : kKept * most)) {
      chosen.push_back(place.anchor);
      size += count;
    } else if (is_near) {
      missing += count;
    }
  }
  load(chosen, keyframes, optimizer);
  return missing;
}

void ActiveRegion::store_far(std::size_t view, double range_m, const KeyframeStore& keyframes,
                             MapOptimizer& optimizer) {
  const auto most = static_cast<double>(optimizer.max_gaussians());
  auto size = static_cast<double>(optimizer.size());
  if (size < kFull * most || !storage_.has_room(max_stored_bytes_)) return;
  if (view < look_again_) return;
  const std::vector<DevicePart> parts = device_parts(optimizer, keyframes.size());
  std::vector<std::int64_t> with_gaussians;
  for (std::size_t i = 0; i < parts.size(); ++i) {
    if (parts[i].count == 0.0) continue;
    with_gaussians.push_back(static_cast<std::int64_t>(i));
    spheres_[with_gaussians.back()] = to_camera(keyframes[i].T_camera_world, parts[i].in_world);
  }
  const std::vector<Place> active = places(with_gaussians, view, range_m, keyframes);
  std::vector<std::int64_t> chosen;
  for (auto place = active.rbegin(); place != active.rend() && size > kKept * most; ++place) {
    const Sphere margin = inflated(place->in_camera, kStoreMargin * range_m);
    if (may_see(keyframes[view].intrinsics, margin, kFarOverUsual * range_m)) continue;
    chosen.push_back(place->anchor);
    size -= parts[static_cast<std::size_t>(place->anchor)].count;
  }
  const double freed = static_cast<double>(optimizer.size()) - size;
  if (freed < kSwapped * most) {
    look_again_ = view + kPatience;  // all is near: the least important ones are replaced
  } else {
    store(chosen, range_m, keyframes, optimizer);
    write_farthest(view, range_m, keyframes);
  }
}

void ActiveRegion::write_farthest(std::size_t view, double range_m,
                                  const KeyframeStore& keyframes) {
  if (static_cast<double>(storage_.bytes()) <= max_stored_bytes_) return;
  std::vector<std::int64_t> farthest_first;
  for (const Place& place : places(storage_.anchors(), view, range_m, keyframes)) {
    farthest_first.push_back(place.anchor);
  }
  std::reverse(farthest_first.begin(), farthest_first.end());
  storage_.write(farthest_first, kLeftInMemory * max_stored_bytes_);
}

void ActiveRegion::load(const std::vector<std::int64_t>& anchors, const KeyframeStore& keyframes,
                        MapOptimizer& optimizer) {
  if (anchors.empty()) return;
  const std::int64_t before = storage_.size();
  std::vector<DetachedGaussians> parts = storage_.take(anchors);
  while (!parts.empty()) {
    try {
      optimizer.attach(parts.back(), keyframes);
    } catch (const c10::Error&) {  // out of memory: nothing is lost
      for (const DetachedGaussians& part : parts) storage_.add(part);
      throw;
    }
    parts.pop_back();
  }
  for (auto& [view, missing] : missing_) {
    for (auto anchor = missing.begin(); anchor != missing.end();) {
      anchor = storage_.holds(*anchor) ? std::next(anchor) : missing.erase(anchor);
    }
  }
  for (auto entry = missing_.begin(); entry != missing_.end();) {
    entry = entry->second.empty() ? missing_.erase(entry) : std::next(entry);
  }
  log::debug("map: {} Gaussians loaded, {} stored", before - storage_.size(), storage_.size());
}

void ActiveRegion::store(const std::vector<std::int64_t>& anchors, double range_m,
                         const KeyframeStore& keyframes, MapOptimizer& optimizer) {
  const Tensor which = belongs_to(optimizer.anchors(), anchors, keyframes.size());
  pause_views(anchors, which, range_m, keyframes, optimizer);
  storage_.add(optimizer.detach(which));
  log::debug("map: {} Gaussians on the device, {} stored", optimizer.size(), storage_.size());
}

// Gaussians far behind what a keyframe shows are in its view too, so ranges are limited.
void ActiveRegion::pause_views(const std::vector<std::int64_t>& anchors, const Tensor& which,
                               double range_m, const KeyframeStore& keyframes,
                               const MapOptimizer& optimizer) {
  const std::int64_t stride = std::max<std::int64_t>(1, optimizer.size() / kProjected);
  const auto sample = [stride](const Tensor& t) { return t.slice(0, 0, c10::nullopt, stride); };
  const Tensor means = sample(optimizer.map().means).contiguous();
  const Tensor sources = sample(optimizer.anchors());
  const Tensor stored = sample(which);
  for (const std::size_t view : keyframes.training()) {
    const double seen_m = far_m(view, range_m);
    const auto sees = [&](std::int64_t anchor) {
      const Tensor& T_own = keyframes[static_cast<std::size_t>(anchor)].T_camera_world;
      const Sphere in_world = to_world(T_own, spheres_.at(anchor));
      return may_see(keyframes[view].intrinsics,
                     to_camera(keyframes[view].T_camera_world, in_world), seen_m);
    };
    if (std::none_of(anchors.begin(), anchors.end(), sees)) continue;
    gaussians::View camera = keyframes.view(view, 1);
    camera.T_camera_world = camera.T_camera_world.to(means.options());
    const ProjectedPoints seen = project(camera, means);
    const Tensor in_view = seen.in_view & (seen.points.norm(2, 1) < seen_m);
    const Tensor missing = in_view & stored;
    const auto total = in_view.sum().item<double>();
    if (missing.sum().item<double>() <= kMaxMissing * total) continue;
    const Tensor unique = std::get<0>(at::_unique(sources.index({missing})));
    for (const std::int64_t anchor : gaussians::host_values<std::int64_t>(unique))
      missing_[view].insert(anchor);
  }
}

gaussians::Gaussians ActiveRegion::complete(const KeyframeStore& keyframes,
                                            const MapOptimizer& optimizer,
                                            const torch::Device& device) const {
  const torch::NoGradGuard no_grad;
  std::vector<gaussians::Gaussians> parts = {gaussians::on_device(optimizer.map(), device)};
  std::vector<std::int64_t> batch;
  std::int64_t size = 0;
  const auto read_batch = [&] {
    for (const DetachedGaussians& part : storage_.read(batch)) {
      parts.push_back(gaussians::on_device(optimizer.in_present_colors(part, keyframes), device));
    }
    batch.clear();
    size = 0;
  };
  for (const std::int64_t anchor : storage_.anchors()) {
    batch.push_back(anchor);
    size += storage_.size(anchor);
    if (size >= kReadAtOnce) read_batch();
  }
  read_batch();
  return gaussians::join(parts);
}

gaussians::Gaussians ActiveRegion::preview(const KeyframeStore& keyframes,
                                           const MapOptimizer& optimizer) const {
  const torch::NoGradGuard no_grad;
  if (storage_.size() == 0) return optimizer.map();
  const std::pair now(storage_.version(), optimizer.appearance_version());
  if (!thinned_ || thinned_version_ != now) {
    std::vector<gaussians::Gaussians> parts;
    for (const DetachedGaussians& part : storage_.sample()) {
      parts.push_back(optimizer.in_present_colors(part, keyframes));
      parts.back().log_scales += 0.5 * std::log(GaussianStorage::kSampleStride);  // the same area
    }
    thinned_ = gaussians::join(parts);
    thinned_version_ = now;
  }
  return gaussians::join(optimizer.map(), *thinned_);
}

// Keyframes that see stored Gaussians.
void ActiveRegion::pause(KeyframeStore& keyframes, OnlineTraining& training) const {
  std::set<std::size_t> views;
  for (const auto& [view, missing] : missing_) views.insert(view);
  training.pause(views);
  for (const std::size_t lost : keyframes.keep_off_device(views)) training.remove_view(lost);
}

StorageFiles ActiveRegion::save(torch::serialize::OutputArchive& archive,
                                const MapOptimizer& optimizer) const {
  torch::serialize::OutputArchive storage;
  StorageFiles files = storage_.save(storage, optimizer.appearance_version());
  archive.write("storage", storage);
  archive.write("look_again", c10::IValue(static_cast<std::int64_t>(look_again_)));
  std::vector<double> spheres;
  for (const auto& [anchor, sphere] : spheres_) {
    const auto& [x, y, z] = sphere.center;
    spheres.insert(spheres.end(), {static_cast<double>(anchor), x, y, z, sphere.radius_m});
  }
  archive.write("spheres", torch::tensor(spheres, torch::kFloat64).reshape({-1, 5}));
  std::vector<std::int64_t> missing;
  for (const auto& [view, anchors] : missing_) {
    for (const std::int64_t anchor : anchors) {
      missing.insert(missing.end(), {static_cast<std::int64_t>(view), anchor});
    }
  }
  archive.write("missing", torch::tensor(missing, torch::kInt64).reshape({-1, 2}));
  return files;
}

StorageFiles ActiveRegion::load(torch::serialize::InputArchive& archive, KeyframeStore& keyframes,
                                MapOptimizer& optimizer, OnlineTraining& training) {
  spheres_.clear();
  missing_.clear();
  look_again_ = static_cast<std::size_t>(gaussians::read_int(archive, "look_again"));
  torch::serialize::InputArchive storage;
  archive.read("storage", storage);
  StorageFiles files = storage_.load(storage, optimizer.appearance_version());
  optimizer.adopt(storage_.size());
  Tensor spheres;
  archive.read("spheres", spheres);
  const auto row = spheres.accessor<double, 2>();
  for (std::int64_t k = 0; k < spheres.size(0); ++k) {
    spheres_[static_cast<std::int64_t>(row[k][0])] = {{row[k][1], row[k][2], row[k][3]}, row[k][4]};
  }
  Tensor missing;
  archive.read("missing", missing);
  for (std::int64_t k = 0; k < missing.size(0); ++k) {
    missing_[static_cast<std::size_t>(missing[k][0].item<std::int64_t>())].insert(
        missing[k][1].item<std::int64_t>());
  }
  pause(keyframes, training);
  return files;
}

}  // namespace apvi::mapping
