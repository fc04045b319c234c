// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <optional>

#include "apvi/mapping/depth_options.hpp"
#include "apvi/splat/lamp.hpp"

namespace apvi::mapping {

inline constexpr int kMostShDegree = 3;  ///< splat::kMaxShDegree, without LibTorch's headers

/// Where a map gets new Gaussians from, besides those it starts with.
enum class Densification {
  none,
  gradient,  ///< where the loss pulls at the projected centres (Kerbl et al., 2023)
  random,    ///< the same, and at random pixels of the keyframes
  quadtree,  ///< as gradient, and where the quadtree finds depth
};

/// Adam's learning rates. That of the means is in scene extents and falls exponentially to
/// `_final`; the others fall in the second half of the training to `late_factor` of what they were,
/// so that the map comes to rest.
struct LearningRates {
  double means = 1.6e-4;
  double means_final = 1.6e-6;
  double log_scales = 5e-3;
  double quaternions = 1e-3;
  double logit_opacities = 2.5e-2;
  double sh_dc = 2.5e-3;
  double sh_rest = 1.25e-4;
  double late_factor = 1.0;

  /// All rates so many times as large.
  LearningRates times(double factor) const {
    return {.means = factor * means,
            .means_final = factor * means_final,
            .log_scales = factor * log_scales,
            .quaternions = factor * quaternions,
            .logit_opacities = factor * logit_opacities,
            .sh_dc = factor * sh_dc,
            .sh_rest = factor * sh_rest,
            .late_factor = late_factor};
  }
};

/// Growth and pruning. `begin` and `end` are parts of the whole training, 0 to 1.
struct DensifyOptions {
  Densification kind = Densification::gradient;
  int max_gaussians = 100000;
  int interval = 100;  ///< iterations between two rounds
  double begin = 0.03;
  double end = 0.6;
  double gradient_threshold = 2e-4;  ///< of the mean screen-space gradient, in half image sizes
  double dense_fraction = 0.01;      ///< of the scene extent: larger Gaussians split, others clone
  int random_per_round = 500;
  double prune_opacity = 0.005;
  double prune_weight = 0.01;  ///< largest blend weight over a round that still is no use
  double prune_scale = 0.3;    ///< of the scene extent: larger ones go
};

/// Correction of the keyframes' poses, held near the given ones by a prior.
struct PoseOptions {
  bool enabled = false;
  double begin = 0.1;  ///< part of the training before which the map is too rough
  double rate = 3e-4;  ///< of Adam [m], [rad]
  double sigma_m = 0.02;
  double sigma_deg = 0.5;
};

/// Gain and offset of a keyframe's colours, held near one and zero by a prior.
struct ExposureOptions {
  bool enabled = false;
  double rate = 1e-3;
  double sigma = 0.05;
};

struct TrainerOptions {
  int iterations = 7000;       ///< with growth and falling rates
  int final_iterations = 0;    ///< after them, without growth, at the final rates
  double time_budget_s = 0.0;  ///< 0: none; else the iterations are spread over at most this
  int sh_degree = kMostShDegree;
  int sh_interval = 1000;  ///< iterations until one more degree is used
  double ssim_weight = 0.2;
  double smoothness = 1.0;     ///< weight of `bentness`
  int coarsest = 4;            ///< reduction of the images at the start: 1, 2 or 4
  double coarse_until = 0.25;  ///< part of the training after which images are whole
  bool antialiased = false;
  bool auto_gain = true;     ///< whether every keyframe has a brightness of its own
  bool sparse_adam = false;  ///< a step changes only what its view sees
  std::optional<splat::Lamp> lamp = std::nullopt;  ///< on the vehicle; counts where water is learnt
  std::uint64_t seed = 0;
  LearningRates rates;
  DensifyOptions densify;
  PoseOptions poses;
  ExposureOptions exposure;
};

/// A map that grows while its keyframes come in.
struct OnlineOptions {
  int steps_per_keyframe = 30;  ///< when nobody waits for the clock
  int recent_keyframes = 10;    ///< the newest, which are drawn more often
  double recent_share = 0.15;   ///< of the draws that are among them
  int pyramid_uses = 4;  ///< of a keyframe at each reduced size, from TrainerOptions::coarsest
  double memory_mib = 1024.0;  ///< of the keyframes' images
  int heldout_views = 100;     ///< at most so many are kept, spread over the whole run
  int medium_after = 5;        ///< keyframes before the water is looked for
  /// As TrainerOptions::sparse_adam. What few views see would be thrown about by each of them: to
  /// Adam's mean square, which falls while nobody looks, a gradient after a long time is a large
  /// one.
  bool sparse_adam = true;
  /// A map's rates fall to this part of what they are while it grows. What is new begins near
  /// where it belongs, and at the rates of a first guess the rest follows noise.
  double late_rates = 0.4;
  int late_rates_steps = 10000;  ///< steps in which they do so, but for 1/e
  bool align = true;  ///< whether keyframes are put where the map that they meet again has them
  double keyframe_share = 0.02;  ///< of the largest map, for one keyframe's Gaussians at most
  double growth_share = 0.01;    ///< of the room left at a keyframe, for cloning and splitting
  /// Steps between two rounds of growth and pruning: as many as two keyframes have, but at least
  /// DensifyOptions::interval and at most so many. What has come from depth needs time to settle:
  /// before that it is pulled at as if it were to be cloned, and what hardly a view has shown yet
  /// goes.
  int densify_interval = 300;
  double drift_m = 0.002;       ///< of odometry against the map, thought possible a second
  double drift_deg = 0.01;      ///< the same of directions
  double point_sigma = 0.1;     ///< of a sparse point along its ray over its distance, at most
  double opacity = 0.2;         ///< of new Gaussians
  int depth_lag = 2;            ///< keyframes that a depth estimate waits for, to see both sides
  int depth_every = 1;          ///< keyframes from one estimate to the next
  double covered_alpha = 0.9;   ///< a block that is drawn so densely
  double covered_error = 0.05;  ///< and so well (mean absolute error) needs no Gaussian
  /// By daylight Gaussians that are nearer than this part of a depth that is believed, where a view
  /// looks through to it, go: what they show is behind them. 0: none.
  double free_space = 0.8;
};

struct MapperOptions {
  bool medium = false;  ///< whether the water is learnt too
  TrainerOptions trainer;
  OnlineOptions online;
  DepthOptions depth;  ///< with a lamp all views and all pixels of a patch count, whatever it says
};

}  // namespace apvi::mapping
