// SPDX-License-Identifier: BSD-3-Clause
#include "runs/survey/survey_depth.hpp"

#include <torch/torch.h>

#include <algorithm>
#include <limits>
#include <optional>
#include <set>
#include <utility>
#include <vector>

#include "apvi/core/error.hpp"
#include "apvi/core/log.hpp"
#include "depth/depth_refinement.hpp"
#include "runs/maps/posed_images.hpp"
#include "survey/mesh_views.hpp"

namespace apvi::runs {
namespace {

using torch::Tensor;

constexpr int kMaxWidth = 1280;  // [px] of the images that are compared
constexpr int kCoarser = 2;      // pixels of an image per pixel of its depth
constexpr std::size_t kComparisons = 8;
constexpr std::int64_t kProbes = 12;  // along the shorter side choose the images to compare with
constexpr double kMinConfidence = 0.02;
constexpr double kSameStamp_s = 1e-3;

/// Views whose depth is refined with the same images in memory.
struct Batch {
  std::vector<std::size_t> references;
  std::vector<Tensor> depths;                      ///< of each reference, [h,w] float32
  std::vector<std::vector<std::size_t>> compared;  ///< with each reference
};

/// Surface points [n,3] of a depth image in the frame of the map.
Tensor probes(const gaussians::View& view, const Tensor& depth) {
  const gaussians::Intrinsics& k = view.intrinsics;
  const std::int64_t step =
      std::max(std::int64_t{1}, std::min(depth.size(0), depth.size(1)) / kProbes);
  const Tensor coarse = depth.slice(0, step / 2, {}, step).slice(1, step / 2, {}, step);
  const Tensor pixel = (coarse > 0.0).nonzero();
  const Tensor z = coarse.index({coarse > 0.0}).to(torch::kFloat64);
  const Tensor at = pixel.to(torch::kFloat64) * step + step / 2 + 0.5;
  const Tensor points = torch::stack(
      {(at.select(1, 1) - k.cx) / k.fx * z, (at.select(1, 0) - k.cy) / k.fy * z, z}, 1);
  const Tensor T = view.T_camera_world.to(points.options());
  return (points - T.slice(0, 0, 3).select(1, 3)).mm(T.slice(0, 0, 3).slice(1, 0, 3));
}

class ImageComparison {
 public:
  ImageComparison(SurveySource& source, const survey::Progress& progress)
      : source_(source),
        progress_(progress),
        cameras_(survey::cameras_of(source.views)),
        options_(source.config->mapping.depth) {
    const gaussians::Intrinsics& k = cameras_.front().intrinsics;
    factor_ = std::max(1, (k.width + kMaxWidth - 1) / kMaxWidth);
    const double bytes = 3.0 * k.width * k.height;
    const double budget = source.config->mapping.online.image_memory_mib * (1 << 20);
    batch_size_ = std::max<std::size_t>(kComparisons, static_cast<std::size_t>(budget / bytes / 2));
  }

  void run() {
    for (std::size_t first = 0; first < cameras_.size(); first += batch_size_) {
      refine(batch_from(first));
    }
  }

 private:
  Batch batch_from(std::size_t first) {
    Batch batch;
    for (std::size_t i = first; i < std::min(first + batch_size_, cameras_.size()); ++i) {
      announce(static_cast<double>(i));
      survey::SurveyView coarse{cameras_[i]};
      gaussians::Intrinsics& k = coarse.camera.intrinsics;
      k = k.scaled(std::max(1, k.width / factor_ / kCoarser),
                   std::max(1, k.height / factor_ / kCoarser));
      const Tensor depth = survey::reliable_depth(source_.map.map, coarse);
      batch.compared.push_back(
          survey::comparison_views(cameras_, i, probes(coarse.camera, depth), kComparisons));
      batch.references.push_back(i);
      batch.depths.push_back(depth);
    }
    return batch;
  }

  /// Half of the work is the drawing of the depths.
  void announce(double drawn) {
    progress_(0.5 * (drawn + refined_) / static_cast<double>(cameras_.size()));
  }

  PosedImages load(const Batch& batch) const {
    std::set<std::size_t> wanted(batch.references.begin(), batch.references.end());
    for (const auto& others : batch.compared) wanted.insert(others.begin(), others.end());
    Trajectory poses;
    for (const std::size_t i : wanted) poses.poses.push_back(source_.bodies.poses[i]);
    return load_posed_images(*source_.config,
                             {.origin = source_.origin, .poses_of_images = std::move(poses)});
  }

  void refine(const Batch& batch) {
    const PosedImages images = load(batch);
    for (std::size_t i = 0; i < batch.references.size(); ++i, ++refined_) {
      announce(static_cast<double>(batch.references.back() + 1));
      source_.views[batch.references[i]].depth_change =
          change_of(images, batch.references[i], batch.depths[i], batch.compared[i]);
    }
  }

  std::optional<std::size_t> find(const PosedImages& images, std::size_t view) const {
    const Stamp stamp = source_.bodies.poses[view].stamp + images.camera_delay;
    const std::int64_t tolerance = Duration::from_seconds(kSameStamp_s).ns;
    const auto& by_stamp = images.store.by_stamp();
    const auto found = by_stamp.lower_bound(stamp.ns - tolerance);
    if (found == by_stamp.end() || found->first > stamp.ns + tolerance) return std::nullopt;
    return found->second;
  }

  /// 1 where an image shows the scene, [h,w] as its depth.
  Tensor scene_of(const PosedImages& images, std::size_t i, const Tensor& depth) const {
    const Tensor scene = images.store.scene(i, factor_, depth.device());
    if (!scene.defined()) return torch::ones_like(depth);
    return survey::resized(scene.to(torch::kFloat32), depth.size(0), depth.size(1));
  }

  depth::DepthView view_of(const PosedImages& images, std::size_t i,
                           const torch::Device& device) const {
    return {.gray = depth::to_gray(images.store.image_values(i, factor_, device)),
            .camera = images.store.view(i, factor_)};
  }

  /// See SurveyView; NaN everywhere without an image.
  Tensor change_of(const PosedImages& images, std::size_t reference, const Tensor& depth,
                   const std::vector<std::size_t>& compared) const {
    const Tensor unknown = torch::full_like(depth, std::numeric_limits<float>::quiet_NaN());
    const auto own = find(images, reference);
    if (!own) return unknown.to(torch::kCPU, torch::kHalf);
    depth::RefinementRequest request{.views = {view_of(images, *own, depth.device())},
                                     .depth = depth * scene_of(images, *own, depth)};
    for (const std::size_t i : compared) {
      if (const auto other = find(images, i)) {
        request.views.push_back(view_of(images, *other, depth.device()));
      }
    }
    const depth::RefinedDepth refined = depth::refine_depth(request, options_);
    const Tensor confirmed = refined.confidence >= kMinConfidence;
    return torch::where(confirmed, refined.ratio - 1.0, unknown).to(torch::kCPU, torch::kHalf);
  }

  SurveySource& source_;
  const survey::Progress& progress_;
  std::vector<gaussians::View> cameras_;
  depth::DepthOptions options_;
  int factor_ = 1;  ///< by which images are reduced
  std::size_t batch_size_ = 1;
  double refined_ = 0.0;
};

}  // namespace

bool compare_survey_images(SurveySource& source, const survey::Progress& progress) {
  if (!source.config || source.views.empty()) return false;
  const torch::NoGradGuard no_grad;
  try {
    ImageComparison(source, progress).run();
    return true;
  } catch (const InputError& error) {
    log::warning("{}; the surface is where the map shows it", error.what());
    for (survey::SurveyView& view : source.views) view.depth_change = Tensor();
    return false;
  }
}

}  // namespace apvi::runs
