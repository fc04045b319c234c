// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/types.h>

#include <cstddef>
#include <cstdint>
#include <optional>

#include "apvi/mapping/densify.hpp"
#include "apvi/mapping/keyframe_store.hpp"
#include "apvi/mapping/options.hpp"
#include "apvi/mapping/view_corrections.hpp"
#include "apvi/splat/gaussian_store.hpp"
#include "apvi/splat/medium_optimizer.hpp"
#include "apvi/splat/render.hpp"

namespace apvi::mapping {

/// How one step is made; what changes from one to the next.
struct StepSettings {
  int reduction = 1;  ///< of the image
  int sh_degree = splat::kMaxShDegree;
  bool correct_pose = false;
  splat::GaussianRates rates;
};

/// Learning rates at a point of a training, 0 to 1, of a scene of that extent [m].
splat::GaussianRates rates_at(const LearningRates& rates, double extent, double progress);

/// A map with all that is learnt beside it (the water, corrections of the views) and what learning
/// remembers. Whoever owns it decides on views, schedules and growth: `Trainer` for keyframes that
/// are all there, `Mapper` for keyframes that come.
class MapLearner {
 public:
  /// Takes a copy of the Gaussians. With `medium`, the map is seen through water that is learnt
  /// too, from there.
  MapLearner(const splat::Gaussians& initial, const TrainerOptions& options, std::size_t views,
             const std::optional<splat::Medium>& medium = std::nullopt);

  /// One step towards the picture of view `i`; returns its loss, a tensor on the map's device that
  /// nothing has waited for.
  torch::Tensor step(const KeyframeStore& keyframes, std::size_t i, const StepSettings& settings);

  /// A round of growth, up to `limit` Gaussians, and of pruning.
  DensifyResult densify(double extent, std::int64_t limit, std::uint64_t seed);
  /// Adds Gaussians; `anchors` as in GaussianStore.
  void insert(const splat::Gaussians& gaussians, const torch::Tensor& anchors = {});
  /// Takes out those where `remove` [size()] (bool) is set.
  void remove(const torch::Tensor& remove);
  /// Moves the Gaussians of one anchor.
  void move(std::int64_t anchor, const splat::Similarity& motion);
  /// From now on the map is seen through water. Colours so far were learnt as seen through it;
  /// `ranges` [size()] says from how far each was seen [m], so that it is taken out of them.
  void begin_medium(const splat::Medium& medium, const torch::Tensor& ranges);
  void set_vio_failing(bool failing);
  /// One more view.
  void add_view() { corrections_.add_view(); }

  /// The map as it is; shares memory with the learner's.
  splat::Gaussians map() const;
  std::int64_t size() const { return store_.size(); }
  torch::Tensor anchors() const { return store_.anchors(); }
  std::optional<splat::Medium> medium() const;
  /// Adam's rate of the water.
  std::optional<double> medium_rate() const;
  const ViewCorrections& corrections() const { return corrections_; }

  void save(torch::serialize::OutputArchive& archive) const;
  /// Throws c10::Error when the archive does not fit.
  void load(torch::serialize::InputArchive& archive);

 private:
  torch::Tensor image_of(std::size_t view, const splat::View& camera,
                         const splat::RenderOutput& out);
  void forget_statistics();

  TrainerOptions options_;
  splat::GaussianStore store_;
  DensityStatistics statistics_;
  ViewCorrections corrections_;
  std::optional<splat::MediumOptimizer> medium_;
};

}  // namespace apvi::mapping
