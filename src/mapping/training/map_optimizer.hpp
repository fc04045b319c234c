// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/types.h>

#include <cstddef>
#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <vector>

#include "apvi/mapping/options.hpp"
#include "gaussians/model/gaussian_store.hpp"
#include "gaussians/render/render.hpp"
#include "mapping/appearance/illumination.hpp"
#include "mapping/appearance/session_light.hpp"
#include "mapping/appearance/view_corrections.hpp"
#include "mapping/appearance/view_gains.hpp"
#include "mapping/density/densify.hpp"
#include "mapping/keyframes/keyframe_store.hpp"
#include "mapping/medium/medium_estimation.hpp"
#include "mapping/medium/medium_support.hpp"
#include "mapping/rendering.hpp"
#include "medium/medium_optimizer.hpp"
#include "medium/medium_view.hpp"

namespace apvi::mapping {

class RobustWeights;

/// Settings of one optimizer step.
struct StepSettings {
  int reduction = 1;  ///< image downscale factor
  int sh_degree = gaussians::kMaxShDegree;
  bool correct_pose = false;
  bool match_gain = true;  ///< with TrainerOptions::gain_compensation
  gaussians::GaussianLearningRates rates;
};

/// Camera response of all views.
struct CameraResponse {
  medium::Vignetting vignetting;
  torch::Tensor log_gains;          ///< [n]; undefined: unknown
  torch::Tensor illumination = {};  ///< [n,3,rows,columns], see Illumination; undefined: unknown
};

/// Gaussians taken out of a map, with what it takes to put them back after its appearance changed.
struct DetachedGaussians {
  gaussians::GaussianRows rows;
  torch::Tensor importance;               ///< [n] float32 in host memory
  std::shared_ptr<const Map> appearance;  ///< of the map at that time; without Gaussians
  int appearance_version = 0;
  torch::Tensor motions = {};  ///< [m,4,4] float64 of the world since then; undefined: none
  torch::Tensor which = {};    ///< [n] int64, index of the motion of each
};

/// Learning rates at `progress` (0 to 1) of a training, for a scene of `extent` [m].
gaussians::GaussianLearningRates rates_at(const LearningRates& rates, double extent,
                                          double progress);

/// Optimizes a map together with its medium and per-view corrections, and holds the optimizer
/// state. The owner chooses views, schedules and densification: `Trainer` offline, `Mapper` online.
///
/// Several sessions can share one set of Gaussians: each has its own medium, light and camera
/// response, with an optimizer of its own that `session` makes.
class MapOptimizer {
 public:
  /// Copies the Gaussians. With `medium`, the water is optimized too, starting from it.
  MapOptimizer(const gaussians::Gaussians& initial, const TrainerOptions& options,
               std::size_t views, const std::optional<medium::Medium>& medium = std::nullopt);

  /// An optimizer of the same Gaussians for the views of another session, whose light has the color
  /// `light` [3] relative to that of this one. From now on a new medium of either does not recolor
  /// the Gaussians, because the other's images would no longer fit.
  MapOptimizer session(const TrainerOptions& options, std::size_t views,
                       const std::optional<medium::Medium>& medium, const torch::Tensor& light);

  /// One optimizer step on the image of view `i`; returns its loss as a tensor on the map's device,
  /// without synchronizing.
  torch::Tensor step(const KeyframeStore& keyframes, std::size_t i, const StepSettings& settings);

  /// Densifies, up to `limit` Gaussians, and prunes. `passed`: steps since the last call.
  DensifyResult densify(double extent, std::int64_t limit, std::uint64_t seed, std::int64_t passed);
  /// Adds Gaussians; `anchors` as in GaussianStore.
  void insert(const gaussians::Gaussians& gaussians, const torch::Tensor& anchors = {});
  /// Removes the Gaussians where `remove` [size()] (bool) is set.
  void remove(const torch::Tensor& remove);
  /// Takes the Gaussians where `which` [size()] (bool) is set out of the map, into host memory.
  DetachedGaussians detach(const torch::Tensor& which);
  /// Puts them back, in the colors of the present medium and camera response.
  void attach(const DetachedGaussians& detached, const KeyframeStore& keyframes);
  /// Counts Gaussians of a checkpoint as taken out of the map.
  void adopt(std::int64_t detached);
  /// Counts the changes of the medium and the camera response that recolored the map.
  int appearance_version() const { return shared_->appearance_version; }
  /// Copies them, on the map's device, as `attach` would put them into the map.
  gaussians::Gaussians in_present_colors(const DetachedGaussians& detached,
                                         const KeyframeStore& keyframes) const;
  /// Removes the `count` least important Gaussians among those where `among` [size()] (bool) is
  /// set, or among all when undefined.
  void prune_least_important(std::int64_t count, const torch::Tensor& among = {});
  /// Keeps the `count` most important Gaussians, which is the limit from then on, and frees spare
  /// capacity. Allocates no device memory for it, and repairs the state after an operation that ran
  /// out of memory.
  void keep_most_important(int count);
  /// Sorts the Gaussians along a space-filling curve (see gaussians::morton_order), which speeds up
  /// rendering on a GPU. `densify` calls it periodically.
  void reorder();
  /// Moves the Gaussians of each listed anchor by its rigid motion [4,4] (float64).
  void move(const std::map<std::int64_t, torch::Tensor>& motions);
  /// Changes the unit of length of the map: its images stay the same. Past estimations of the
  /// medium are forgotten, its current value is kept.
  void change_scale(const gaussians::ScaleChange& change);
  /// Begins to optimize the medium, without a prior. Recolors the Gaussians so that the keyframes'
  /// renderings stay the same.
  void start_medium(const medium::Medium& medium, const KeyframeStore& keyframes);
  /// Applies a medium estimation with its gains and vignetting, and sets it as the prior (see
  /// medium::MediumOptimizer::set_prior). Recolors like `start_medium`. Gains of keyframes it did
  /// not use are interpolated; afterwards the median gain of the training keyframes is one. The
  /// tone curve becomes that of the estimation. Without MediumSupport, the map gets no medium, or
  /// loses it.
  void apply_medium(const MediumEstimation& estimation, const KeyframeStore& keyframes);
  /// Keeps the medium as it is until `apply_medium`.
  void hold_medium();
  /// Keeps the median of the gains of `views` as it is from now on; see ViewGains.
  void hold_median_gain(const std::vector<std::size_t>& views) { gains_.hold_median(views); }
  /// Continues from a known camera response. Moving light must be tracked before.
  void start_from(const CameraResponse& response);
  /// Estimates the gain of a new view before its image is used.
  void match_gain(const KeyframeStore& keyframes, std::size_t i);
  /// Measures the gain of a view of a finished map.
  void measure_gain(const KeyframeStore& keyframes, std::size_t i);
  /// Follows moving light from now on, with gain compensation; see Illumination.
  void track_illumination(const KeyframeStore& keyframes);
  /// Doubles the learning rate of the medium while VIO fails.
  void set_vio_failing(bool failing);
  /// Adds a view.
  void add_view();

  /// The current Gaussians; share memory with the optimizer.
  gaussians::Gaussians map() const;
  /// The same with medium and camera response.
  Map full_map() const;
  std::int64_t size() const { return shared_->store.size(); }
  /// Maximum number of Gaussians, which the owner respects: as configured, the default of the
  /// device, or less after `keep_most_important`.
  int max_gaussians() const { return shared_->max_gaussians; }
  /// Number of Gaussians until this limit.
  std::int64_t room() const;
  torch::Tensor anchors() const { return shared_->store.anchors(); }
  /// See DensityStatistics.
  torch::Tensor importance() const { return shared_->statistics.importance(); }
  std::optional<medium::Medium> medium() const;
  /// Combined result of all applied medium estimations.
  const medium::MediumPosterior& medium_posterior() const { return medium_posterior_; }
  /// Adam's learning rate of the medium.
  std::optional<double> medium_rate() const;
  const ViewCorrections& corrections() const { return corrections_; }
  /// Null without TrainerOptions::robust_weights.
  const RobustWeights* robust_weights() const { return robust_weights_.get(); }
  /// Of the camera. That of the keyframes must be the same; their owner copies it after
  /// `apply_medium` and `load`.
  const gaussians::ToneCurve& tone_curve() const { return tone_curve_; }
  const ToneCurveEvidence& tone_curve_evidence() const { return tone_curve_evidence_; }

  void save(torch::serialize::OutputArchive& archive) const;
  /// Loads at most `max_gaussians`, the most important ones. Throws c10::Error when
  /// the archive does not match.
  void load(torch::serialize::InputArchive& archive);
  /// All but the Gaussians.
  void save_session(torch::serialize::OutputArchive& archive) const;
  void load_session(torch::serialize::InputArchive& archive);

 private:
  struct SharedGaussians {
    gaussians::GaussianStore store;
    DensityStatistics statistics;
    int max_gaussians = 0;
    bool has_sessions = false;
    std::int64_t detached = 0;   ///< Gaussians that `detach` took and `attach` did not put back
    int appearance_version = 0;  ///< counts changes that recolored the map
  };

  MapOptimizer(std::shared_ptr<SharedGaussians> shared, const TrainerOptions& options,
               std::size_t views, const std::optional<medium::Medium>& medium);
  void move_to(const torch::Device& device);
  void create_medium(const medium::Medium& medium);
  const medium::MediumView& medium_view(const gaussians::Intrinsics& camera);
  bool optimizes_medium() const;
  bool updates_gain(const StepSettings& settings) const;
  torch::Tensor falloff(const gaussians::Intrinsics& camera);
  void set_tone_curve(const gaussians::ToneCurve& curve);
  const torch::Tensor& light_table(const torch::Device& device);
  /// The image of a view with its gain and vignetting removed.
  struct Target {
    torch::Tensor image;      ///< [h,w,3]
    torch::Tensor saturated;  ///< [h,w,3] bool of clipped values; undefined: none

    /// The image with clipped values raised to `colors` [h,w,3] where those are brighter, because a
    /// clipped value is only a lower bound. Otherwise blue open water that clips in one channel
    /// would be fitted as a surface of another color.
    torch::Tensor saturation_adjusted(const torch::Tensor& colors) const;
  };
  /// Rendering and image of a view for its gain.
  std::pair<RenderedView, torch::Tensor> gain_images(const KeyframeStore& keyframes, std::size_t i);
  Target target_of(const KeyframeStore& keyframes, std::size_t i, const RenderedView& rendered,
                   const StepSettings& settings);
  torch::Tensor pixel_weights(std::size_t i, const RenderedView& rendered,
                              const torch::Tensor& drawn, const torch::Tensor& wanted,
                              const torch::Tensor& scene);
  torch::Tensor without_outliers(std::size_t i, const torch::Tensor& rendered,
                                 const torch::Tensor& image) const;
  void recolor_for(const Map& after, const KeyframeStore& keyframes);
  Map appearance() const;
  void apply_appearance(const Map& after, const torch::Tensor& resolution,
                        const KeyframeStore& keyframes);
  /// The map with another tone curve, which also scales the logarithms of gains.
  Map with_curve(const gaussians::ToneCurve& curve) const;
  void remove_medium(const KeyframeStore& keyframes);

  TrainerOptions options_;
  std::shared_ptr<SharedGaussians> shared_;
  std::optional<SessionLight> light_;
  ViewCorrections corrections_;
  ViewGains gains_;
  std::shared_ptr<RobustWeights> robust_weights_;
  std::optional<Illumination> illumination_;
  medium::Vignetting vignetting_;
  ToneCurveEvidence tone_curve_evidence_;
  gaussians::ToneCurve tone_curve_;
  torch::Tensor light_table_;  ///< of the tone curve, cached
  medium::MediumPosterior medium_posterior_;
  MediumSupport medium_support_;
  std::map<int, torch::Tensor> falloffs_;  ///< by image width
  std::optional<medium::MediumOptimizer> medium_;
  bool vio_failing_ = false;
  /// By image width, without gradients; invalidated when the medium is replaced.
  std::map<int, medium::MediumView> medium_views_;
};

}  // namespace apvi::mapping
