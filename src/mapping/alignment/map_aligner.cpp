// SPDX-License-Identifier: BSD-3-Clause
#include "mapping/alignment/map_aligner.hpp"

#include <torch/torch.h>

#include <algorithm>
#include <vector>

#include "apvi/core/log.hpp"
#include "gaussians/device.hpp"
#include "gaussians/model/archive.hpp"

namespace apvi::mapping {
namespace {

using torch::Tensor;

constexpr int kMinAlignmentWidth_px = 320;
constexpr int kReferenceReduction = 4;  // image reduction for the reference map's coverage

}  // namespace

// Adds the Gaussians of keyframes older than the stamp, once each.
void MapAligner::extend(const KeyframeStore& keyframes, std::int64_t stamp_ns,
                        const MapOptimizer& optimizer) {
  const std::vector<std::size_t>& views = keyframes.training();
  auto next = std::lower_bound(views.begin(), views.end(), end_);
  for (; next != views.end() && keyframes[*next].stamp_ns < stamp_ns; ++next) {
    const Tensor own =
        (optimizer.anchors() == static_cast<std::int64_t>(*next)).nonzero().squeeze(1);
    gaussians::Gaussians own_gaussians = optimizer.map();
    for (Tensor* part : own_gaussians.tensors()) *part = part->index_select(0, own);
    reference_map_.insert(own_gaussians, keyframes.view(*next, kReferenceReduction),
                          keyframes[*next].stamp_ns);
    end_ = *next + 1;
  }
}

std::optional<Tensor> MapAligner::align(const KeyframeStore& keyframes, std::size_t view,
                                        const PoseSigmas& sigmas, const MapOptimizer& optimizer) {
  extend(keyframes, keyframes[view].stamp_ns - kReferenceAge_ns, optimizer);
  Map map = optimizer.full_map();
  map.gaussians = reference_map_.gaussians();
  if (map.gaussians.size() == 0) return std::nullopt;
  const int factor = keyframes[view].intrinsics.width >= 2 * kMinAlignmentWidth_px ? 2 : 1;
  const gaussians::View camera = keyframes.view(view, factor);
  MapRendering rendering = render_map(map, camera);
  const Tensor scene = keyframes.scene(view, factor, rendering.alpha.device());
  if (scene.defined()) rendering.alpha = rendering.alpha * scene;
  const Tensor image = keyframes.image(view, factor, rendering.alpha.device()) /
                       camera_response(map, keyframes, view, factor);
  const auto alignment = align_image(rendering, image, camera.intrinsics, sigmas);
  if (!alignment) return std::nullopt;
  log::debug(
      "{}: aligned to the map, moved by {:.1f} mm; residual {:.4f}, was {:.4f}; "
      "correlation {:.2f} over {:.0f} % of the image",
      keyframes[view].name, 1e3 * motion_size(alignment->T_camera_prior), alignment->residual_after,
      alignment->residual_before, alignment->correlation, 100.0 * alignment->overlap);
  return alignment->T_camera_prior.mm(camera.T_camera_world);
}

void MapAligner::move(const KeyframeMotions& motions, const KeyframeStore& keyframes) {
  for (const auto& [i, motion] : motions) {
    reference_map_.move(keyframes[static_cast<std::size_t>(i)].stamp_ns, motion);
  }
}

void MapAligner::save(torch::serialize::OutputArchive& archive) const {
  torch::serialize::OutputArchive reference_map;
  reference_map_.save(reference_map);
  archive.write("reference_map", reference_map);
  archive.write("reference_end", c10::IValue(static_cast<std::int64_t>(end_)));
}

void MapAligner::load(torch::serialize::InputArchive& archive) {
  torch::serialize::InputArchive reference_map;
  archive.read("reference_map", reference_map);
  reference_map_.load(reference_map, gaussians::active_device());
  end_ = static_cast<std::size_t>(gaussians::read_int(archive, "reference_end"));
}

}  // namespace apvi::mapping
