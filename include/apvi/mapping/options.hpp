// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <vector>

#include "apvi/config/fields.hpp"
#include "apvi/depth/options.hpp"
#include "apvi/medium/lamp.hpp"

namespace apvi::mapping {

inline constexpr int kShDegreeLimit = 3;  ///< gaussians::kMaxShDegree, without LibTorch's headers

/// Source of new Gaussians besides the initial ones.
enum class Densification {
  none,
  gradient,  ///< by the gradient of the projected means (Kerbl et al., 2023)
  random,    ///< as gradient, and at random pixels of the keyframes
  quadtree,  ///< as gradient, and from quadtree depth estimates
};

/// How the medium is found.
enum class MediumEstimationMethod {
  fit,       ///< repeated fits to the map's surfaces, between which it is optimized near the fit
  gradient,  ///< optimized with the map from an initial estimate on, as in the paper; no lamp
};

enum class ToneCurveKind {
  estimated,  ///< with the medium; linear until then
  linear,
  srgb,   ///< IEC 61966-2-1
  power,  ///< value = light^(1/gamma)
};

/// Adam's learning rates. The rate of the means is in scene extents and decays exponentially to
/// `means_final`; the others decay in the second half of the optimization by `final_factor`.
struct LearningRates {
  double means = 1.6e-4;
  double means_final = 1.6e-6;
  double log_scales = 5e-3;
  double quaternions = 1e-3;
  double logit_opacities = 2.5e-2;
  double sh_dc = 2.5e-3;
  double sh_rest = 1.25e-4;
  double final_factor = 1.0;

  /// All rates multiplied by `factor`.
  LearningRates times(double factor) const {
    return {.means = factor * means,
            .means_final = factor * means_final,
            .log_scales = factor * log_scales,
            .quaternions = factor * quaternions,
            .logit_opacities = factor * logit_opacities,
            .sh_dc = factor * sh_dc,
            .sh_rest = factor * sh_rest,
            .final_factor = final_factor};
  }

  template <typename V>
  void visit(V& v) {
    const config::Range positive{0.0, 10.0};
    v("means", means, positive, "positions, initial [scene extents]");
    v("means_final", means_final, positive, "positions, final [scene extents]");
    v("log_scales", log_scales, positive, "logarithms of the scales");
    v("quaternions", quaternions, positive, "rotations");
    v("logit_opacities", logit_opacities, positive, "opacities, before the sigmoid");
    v("sh_dc", sh_dc, positive, "spherical harmonics of degree 0");
    v("sh_rest", sh_rest, positive, "spherical harmonics of higher degrees");
    v("final_factor", final_factor, config::Range{1e-6, 1.0},
      "final factor on all rates but the positions', reached over the second half of the "
      "optimization");
  }
};

/// Densification and pruning. The start and end are fractions of the optimization, 0 to 1.
struct DensifyOptions {
  Densification kind = Densification::gradient;
  int max_gaussians = 0;  ///< 0: 100,000 on a CPU, 600,000 on a GPU
  int interval = 100;     ///< iterations between two rounds
  double start_fraction = 0.03;
  double end_fraction = 0.6;
  double gradient_threshold = 2e-4;  ///< of the mean screen-space gradient, in half image sizes
  double split_scale = 0.01;         ///< of the scene extent: larger Gaussians split, others clone
  int random_per_round = 500;
  double prune_opacity = 0.005;
  double prune_weight = 0.01;  ///< pruned if the largest blend weight of a round is below
  double prune_scale = 0.3;    ///< of the scene extent: larger Gaussians are pruned

  template <typename V>
  void visit(V& v) {
    using config::Range;
    v("interval", interval, Range{1, 1000000}, "steps between two rounds");
    v("start_fraction", start_fraction, Range{0.0, 1.0},
      "fraction of the optimization before the first round");
    v("end_fraction", end_fraction, Range{0.0, 1.0},
      "fraction of the optimization after which no Gaussians are added");
    v("gradient_threshold", gradient_threshold, Range{0.0, 1.0},
      "mean screen-space positional gradient above which a Gaussian is cloned or split [half "
      "images]");
    v("split_scale", split_scale, Range{0.0, 1.0},
      "larger Gaussians are split, smaller ones cloned [scene extents]");
    v("random_per_round", random_per_round, Range{0, 1000000},
      "densification random: new Gaussians at random pixels per round");
    v("prune_opacity", prune_opacity, Range{0.0, 1.0}, "Gaussians of lower opacity are removed");
    v("prune_weight", prune_weight, Range{0.0, 1.0},
      "Gaussians whose blend weight stays below this in all pixels of a round are removed");
    v("prune_scale", prune_scale, Range{0.0, 1e6}, "larger Gaussians are removed [scene extents]");
  }
};

/// Refinement of the keyframe poses, with a prior at the given poses.
struct PoseOptions {
  bool enabled = false;
  double start_fraction = 0.1;  ///< of the optimization; before, the map is too rough
  double learning_rate = 3e-4;  ///< of Adam [m], [rad]
  double prior_sigma_m = 0.02;
  double prior_sigma_deg = 0.5;

  template <typename V>
  void visit(V& v) {
    using config::Range;
    v("enabled", enabled, "refine the keyframe poses");
    v("start_fraction", start_fraction, Range{0.0, 1.0},
      "fraction of the optimization before poses are refined");
    v("learning_rate", learning_rate, Range{0.0, 1.0}, "learning rate [m], [rad]");
    v("prior_sigma_m", prior_sigma_m, Range{1e-6, 1e3},
      "uncertainty of the given positions, one sigma [m]");
    v("prior_sigma_deg", prior_sigma_deg, Range{1e-6, 180.0},
      "uncertainty of the given rotations, one sigma [deg]");
  }
};

/// Per-keyframe color gain and offset, with a prior at one and zero.
struct ExposureOptions {
  bool enabled = false;
  double learning_rate = 1e-3;
  double prior_sigma = 0.05;

  template <typename V>
  void visit(V& v) {
    using config::Range;
    v("enabled", enabled, "optimize a gain and an offset per keyframe");
    v("learning_rate", learning_rate, Range{0.0, 1.0}, "learning rate");
    v("prior_sigma", prior_sigma, Range{1e-6, 10.0},
      "deviation of gains from 1 and of offsets from 0, one sigma");
  }
};

/// Tone curve of the camera: how light becomes image values.
struct ToneCurveOptions {
  ToneCurveKind kind = ToneCurveKind::estimated;
  double gamma = 2.2;  ///< of ToneCurveKind::power

  template <typename V>
  void visit(V& v) {
    v("kind", kind,
      config::Choices<ToneCurveKind>{{"auto", ToneCurveKind::estimated},
                                     {"linear", ToneCurveKind::linear},
                                     {"srgb", ToneCurveKind::srgb},
                                     {"power", ToneCurveKind::power}},
      "how light becomes image values: auto: srgb for JPEG files and live video, otherwise linear "
      "or a power with gamma 2.2, chosen with the medium; srgb; power: value = light^(1/gamma)");
    v("gamma", gamma, config::Range{0.5, 4.0}, "of kind power");
  }
};

struct TrainerOptions {
  int iterations = 7000;  ///< with densification and decaying rates
  /// Afterwards, without densification, at the final rates. nullopt: as the device allows in
  /// incremental mapping, none with given poses.
  std::optional<int> final_iterations = std::nullopt;
  double time_budget_s = 0.0;  ///< 0: none; otherwise the schedule is compressed to this time
  /// The part of a longer schedule that this optimization is, as fractions of it.
  double schedule_start = 0.0;
  double schedule_end = 1.0;
  int sh_degree = kShDegreeLimit;
  int sh_degree_interval = 1000;  ///< iterations per additional degree
  double ssim_weight = 0.2;
  double depth_curvature_weight = 1.0;  ///< weight of `depth_curvature_loss`
  bool robust_weights = false;          ///< see RobustWeights
  int initial_downscale = 4;            ///< initial image reduction: 1, 2 or 4
  double full_resolution_after = 0.25;  ///< fraction of the optimization
  /// The initial map is a finished one: full images, all degrees and gains from the start.
  bool refine = false;
  bool antialiased = false;
  bool gain_compensation = true;  ///< estimate a gain per keyframe
  ToneCurveOptions tone_curve;
  /// A step updates only visible Gaussians. nullopt: no, but OnlineOptions::sparse_adam decides in
  /// incremental mapping.
  std::optional<bool> sparse_adam = std::nullopt;
  MediumEstimationMethod medium_estimation = MediumEstimationMethod::fit;
  std::vector<medium::Lamp> lamps;  ///< on the vehicle; used when the medium is optimized
  std::uint64_t seed = 0;
  LearningRates learning_rates;
  DensifyOptions densify;
  PoseOptions pose_refinement;
  ExposureOptions exposure_correction;
};

/// Depth of the Gaussian that a quadtree block gets.
enum class InsertionDepth {
  block,      ///< of blocks with confident depth
  upsampled,  ///< the upsampled depth, which covers the other blocks too, as in the paper
};

/// Incremental mapping.
struct OnlineOptions {
  int steps_per_keyframe = 0;        ///< when not running in real time; 0: by the device
  int recent_keyframes = 10;         ///< number of newest keyframes that are sampled more often
  double recent_fraction = 0.15;     ///< fraction of samples among them
  int uses_per_pyramid_level = 4;    ///< steps per keyframe and reduced size
  double image_memory_mib = 1024.0;  ///< limit for keyframe images
  /// Limit for the Gaussians far from the camera and their images in host memory.
  double stored_memory_mib = 4096.0;
  /// Limit for what that memory does not hold, in files.
  double stored_disk_mib = 65536.0;
  int max_heldout_views = 100;   ///< at most, evenly spread over the run
  int medium_min_keyframes = 5;  ///< before the first medium estimation
  /// Default of TrainerOptions::sparse_adam. Without it, rarely visible Gaussians take too large
  /// steps, because Adam's second moment decays while they are not visible.
  bool sparse_adam = true;
  /// Learning rates decay to this fraction during mapping: inserted Gaussians start near their
  /// solution, and at full rates the rest of the map would follow noise.
  double final_rate_factor = 0.4;
  int rate_decay_steps = 10000;            ///< time constant of this decay [steps]
  double keyframe_budget_fraction = 0.02;  ///< of max_gaussians, per keyframe
  double densify_budget_fraction = 0.01;   ///< of the free capacity, per keyframe
  /// Densification runs every two keyframes' number of steps, but at least DensifyOptions::interval
  /// and at most this many. Gaussians inserted from depth must converge first: until then their
  /// gradients are large and few views have seen them.
  int max_densify_interval = 300;
  double drift_m_s = 0.002;               ///< odometry drift relative to the map, per second
  double drift_deg_s = 0.01;              ///< the same for orientation
  double max_relative_point_sigma = 0.1;  ///< of a sparse point, sigma over range
  double initial_opacity = 0.2;           ///< of inserted Gaussians
  int depth_lag_keyframes = 2;            ///< later neighbors to wait for
  int depth_every_keyframes = 1;          ///< interval of depth estimates
  double coverage_min_alpha = 0.9;        ///< blocks with at least this alpha
  double coverage_max_error = 0.05;       ///< and at most this mean absolute error are covered
  /// In daylight, Gaussians nearer than this fraction of an accepted depth along the same ray are
  /// removed as free-space violations. 0: none.
  double free_space_depth_ratio = 0.8;
  InsertionDepth insertion_depth = InsertionDepth::block;

  template <typename V>
  void visit(V& v) {
    using config::Range;
    v("steps_per_keyframe", steps_per_keyframe, Range{0, 1000000},
      "optimization steps per keyframe; 0: 30 on a CPU, 100 on a GPU; in realtime mode as many as "
      "time allows");
    v("recent_keyframes", recent_keyframes, Range{1, 1000000},
      "number of newest keyframes that are sampled more often");
    v("recent_fraction", recent_fraction, Range{0.0, 1.0}, "fraction of samples from these");
    v("uses_per_pyramid_level", uses_per_pyramid_level, Range{0, 1000000},
      "uses of a keyframe per pyramid level before the next finer one, from initial_downscale on");
    v("image_memory_mib", image_memory_mib, Range{1.0, 1e9},
      "memory for keyframe images; beyond it the most redundant ones are removed; held-out images "
      "take at most a quarter of it [MiB]");
    v("stored_memory_mib", stored_memory_mib, Range{0.0, 1e9},
      "host memory for the parts of a map far from the camera when max_gaussians of others are on "
      "the device; half for Gaussians, about 500 bytes each, half for images; 0: max_gaussians is "
      "the limit of the map [MiB]");
    v("stored_disk_mib", stored_disk_mib, Range{0.0, 1e9},
      "disk space in the run folder for what stored_memory_mib does not hold; 0: none [MiB]");
    v("max_heldout_views", max_heldout_views, Range{1, 1000000},
      "maximum number of held-out images, spread over the run");
    v("medium_min_keyframes", medium_min_keyframes, Range{1, 1000000},
      "number of keyframes from which the medium is first estimated");
    v("sparse_adam", sparse_adam,
      "value of mapping.sparse_adam if that is null; keeps Gaussians that few keyframes see from "
      "drifting");
    v("keyframe_budget_fraction", keyframe_budget_fraction, Range{1e-6, 1.0},
      "maximum new Gaussians per keyframe, as a fraction of max_gaussians; in a full map they "
      "replace older ones");
    v("densify_budget_fraction", densify_budget_fraction, Range{0.0, 1.0},
      "maximum Gaussians from cloning and splitting per keyframe, as a fraction of the remaining "
      "capacity");
    v("max_densify_interval", max_densify_interval, Range{1, 1000000},
      "maximum steps between two rounds of densify; a round follows every second keyframe, but not "
      "before densify.interval");
    v("final_rate_factor", final_rate_factor, Range{0.01, 1.0},
      "factor that the learning rates decay to");
    v("rate_decay_steps", rate_decay_steps, Range{1, 100000000},
      "time constant of that decay [steps]");
    v("drift_m_s", drift_m_s, Range{1e-6, 10.0},
      "maximum drift of odometry relative to the map [m/s]");
    v("drift_deg_s", drift_deg_s, Range{1e-6, 180.0},
      "maximum rotational drift of odometry relative to the map [deg/s]");
    v("max_relative_point_sigma", max_relative_point_sigma, Range{0.0, 10.0},
      "maximum depth uncertainty of a sparse point, one sigma over depth, to become a Gaussian");
    v("initial_opacity", initial_opacity, Range{1e-3, 0.999}, "opacity of new Gaussians");
    v("depth_lag_keyframes", depth_lag_keyframes, Range{0, 1000},
      "densification quadtree: keyframes to wait before estimating depth");
    v("depth_every_keyframes", depth_every_keyframes, Range{1, 1000},
      "densification quadtree: depth is estimated for every N-th keyframe");
    v("insertion_depth", insertion_depth,
      config::Choices<InsertionDepth>{{"block", InsertionDepth::block},
                                      {"upsampled", InsertionDepth::upsampled}},
      "densification quadtree: depth of new Gaussians: block: of blocks with confident depth; "
      "upsampled: upsampled to pixels, which fills the other blocks too (the paper)");
    v("coverage_min_alpha", coverage_min_alpha, Range{0.0, 1.0},
      "minimum mean rendered alpha of a covered block, which gets no new Gaussian");
    v("coverage_max_error", coverage_max_error, Range{0.0, 1.0},
      "maximum mean absolute error of a covered block");
    v("free_space_depth_ratio", free_space_depth_ratio, Range{0.0, 0.95},
      "without a lamp: Gaussians in front of this fraction of a confident depth are removed; 0: "
      "none");
  }
};

struct MapperOptions {
  bool medium = false;  ///< optimize the water too
  TrainerOptions trainer;
  OnlineOptions online;
  depth::DepthOptions depth;  ///< with a lamp, insertion uses all views and uniform patches
  /// Folder for OnlineOptions::stored_disk_mib, created when it is needed; empty: nothing is
  /// written.
  std::filesystem::path storage_folder = {};
};

}  // namespace apvi::mapping
