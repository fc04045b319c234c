// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/types.h>

#include <cstddef>
#include <cstdint>
#include <map>
#include <optional>
#include <vector>

#include "apvi/mapping/densify.hpp"
#include "apvi/mapping/keyframe_store.hpp"
#include "apvi/mapping/options.hpp"
#include "apvi/mapping/rendering.hpp"
#include "apvi/mapping/view_corrections.hpp"
#include "apvi/mapping/view_gains.hpp"
#include "apvi/mapping/water_survey.hpp"
#include "apvi/splat/gaussian_store.hpp"
#include "apvi/splat/medium_optimizer.hpp"
#include "apvi/splat/medium_view.hpp"
#include "apvi/splat/render.hpp"

namespace apvi::mapping {

/// How one step is made; what changes from one to the next.
struct StepSettings {
  int reduction = 1;  ///< of the image
  int sh_degree = splat::kMaxShDegree;
  bool correct_pose = false;
  bool match_gain = true;  ///< with TrainerOptions::auto_gain
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
  /// `passed`: steps since the last round.
  DensifyResult densify(double extent, std::int64_t limit, std::uint64_t seed, std::int64_t passed);
  /// Adds Gaussians; `anchors` as in GaussianStore.
  void insert(const splat::Gaussians& gaussians, const torch::Tensor& anchors = {});
  /// Takes out those where `remove` [size()] (bool) is set.
  void remove(const torch::Tensor& remove);
  /// Takes out so many of least importance, of those where `among` [size()] (bool) is set;
  /// undefined: of all.
  void drop_least(std::int64_t count, const torch::Tensor& among = {});
  /// Only so many stay, those of most importance, and no memory to spare. Needs none of the device,
  /// and mends what is left of a call that memory ended in.
  void keep_best(std::int64_t most);
  /// Puts Gaussians next to each other in memory that are neighbours in space (see
  /// splat::morton_order), which is drawn faster on a GPU. `densify` does so now and then.
  void reorder();
  /// Moves the Gaussians of anchors, each by a rigid motion [4,4] (float64).
  void move(const std::map<std::int64_t, torch::Tensor>& motions);
  /// From now on the map is seen through this water, which is held near (see
  /// splat::MediumOptimizer::hold). Its colours are changed so that to the keyframes it looks as
  /// before.
  void adopt(const splat::Medium& medium, const torch::Tensor& known,
             const KeyframeStore& keyframes);
  /// The same with all that a survey found. The gains of the keyframes it did not look at follow
  /// their neighbours' that it did; the median of all to learn from is one afterwards.
  void adopt(const WaterSurvey& survey, const KeyframeStore& keyframes);
  /// Finds the gain of a new view before anything is made of its picture.
  void match_gain(const KeyframeStore& keyframes, std::size_t i);
  void set_vio_failing(bool failing);
  /// One more view.
  void add_view();

  /// The Gaussians as they are; share memory with the learner's.
  splat::Gaussians map() const;
  /// The same with water and camera.
  Map whole_map() const;
  std::int64_t size() const { return store_.size(); }
  torch::Tensor anchors() const { return store_.anchors(); }
  /// See DensityStatistics.
  torch::Tensor importance() const { return statistics_.importance(); }
  std::optional<splat::Medium> medium() const;
  /// What was found of the water by all surveys that were adopted.
  const WaterBelief& surveys() const { return surveys_; }
  /// Adam's rate of the water.
  std::optional<double> medium_rate() const;
  const ViewCorrections& corrections() const { return corrections_; }

  void save(torch::serialize::OutputArchive& archive) const;
  /// As many Gaussians as the options' `max_gaussians`, those of most importance. Throws c10::Error
  /// when the archive does not fit.
  void load(torch::serialize::InputArchive& archive);

 private:
  void move_to(const torch::Device& device);
  const splat::MediumView& water_before(const splat::Intrinsics& camera);
  bool learns_water() const;
  bool matches_gain(const StepSettings& settings) const;
  torch::Tensor falloff(const splat::Intrinsics& camera);
  /// What a view's picture has in the map's light.
  struct Target {
    torch::Tensor picture;    ///< [h,w,3]
    torch::Tensor saturated;  ///< [h,w,3] where more light makes it no brighter; undefined: nowhere

    /// The picture with `colors` [h,w,3] where they are brighter than it can be: that they are is
    /// all it says. Blue open water saturates first when a camera exposes for a dark hull, and
    /// would look like a surface of another colour.
    torch::Tensor raised_to(const torch::Tensor& colors) const;
  };
  Target target_of(const KeyframeStore& keyframes, std::size_t i, const DrawnView& drawn,
                   const StepSettings& settings);
  void wear(const Map& after, const torch::Tensor& known, const KeyframeStore& keyframes);

  TrainerOptions options_;
  splat::GaussianStore store_;
  DensityStatistics statistics_;
  ViewCorrections corrections_;
  ViewGains gains_;
  double vignetting_ = 0.0;
  WaterBelief surveys_;
  std::map<int, torch::Tensor> falloffs_;  ///< by width of the picture
  std::optional<splat::MediumOptimizer> medium_;
  /// By width of the picture, without derivatives; as long as the water stays what it is.
  std::map<int, splat::MediumView> waters_;
};

}  // namespace apvi::mapping
