// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "apvi/bridge/depth_section.hpp"
#include "apvi/config/fields.hpp"
#include "apvi/loop/loop_closer.hpp"
#include "apvi/mapping/options.hpp"
#include "apvi/pipeline/run_config.hpp"

namespace apvi::bridge {

// The mapping half knows no configuration files; these give its options their words.

struct RatesSection : mapping::LearningRates {
  template <typename V>
  void visit(V& v) {
    const config::Range positive{0.0, 10.0};
    v("means", means, positive, "of the centres at the start [scene extents]");
    v("means_final", means_final, positive, "of the centres at the end [scene extents]");
    v("log_scales", log_scales, positive, "of the logarithms of the sizes");
    v("quaternions", quaternions, positive, "of the rotations");
    v("logit_opacities", logit_opacities, positive, "of the opacities, before the sigmoid");
    v("sh_dc", sh_dc, positive, "of the constant colours");
    v("sh_rest", sh_rest, positive, "of the other spherical harmonics");
    v("late_factor", late_factor, config::Range{1e-6, 1.0},
      "what all but that of the centres are multiplied by at the end, after falling for half of "
      "the "
      "training");
  }
};

struct DensifySection : mapping::DensifyOptions {
  DensifySection() { max_gaussians = 0; }  // as many as suit the device
  template <typename V>
  void visit(V& v) {
    using config::Range;
    v("interval", interval, Range{1, 1000000}, "iterations between two rounds");
    v("begin", begin, Range{0.0, 1.0}, "part of the training before the first round");
    v("end", end, Range{0.0, 1.0}, "part of the training after which the map grows no more");
    v("gradient_threshold", gradient_threshold, Range{0.0, 1.0},
      "mean pull at a projected centre from which a Gaussian clones or splits [half images]");
    v("dense_fraction", dense_fraction, Range{0.0, 1.0},
      "larger Gaussians split, smaller ones clone [scene extents]");
    v("random_per_round", random_per_round, Range{0, 1000000},
      "densification random: new Gaussians at random pixels each round");
    v("prune_opacity", prune_opacity, Range{0.0, 1.0}, "fainter Gaussians go");
    v("prune_weight", prune_weight, Range{0.0, 1.0},
      "so do those that never weigh more in any pixel of a round");
    v("prune_scale", prune_scale, Range{0.0, 1e6}, "and larger ones [scene extents]");
  }
};

struct PoseSection : mapping::PoseOptions {
  template <typename V>
  void visit(V& v) {
    using config::Range;
    v("enabled", enabled, "whether the keyframes' poses are corrected");
    v("begin", begin, Range{0.0, 1.0}, "part of the training before that");
    v("rate", rate, Range{0.0, 1.0}, "Adam's learning rate [m], [rad]");
    v("sigma_m", sigma_m, Range{1e-6, 1e3}, "how far off the given positions are, one sigma [m]");
    v("sigma_deg", sigma_deg, Range{1e-6, 180.0}, "the same of the rotations [deg]");
  }
};

struct ExposureSection : mapping::ExposureOptions {
  template <typename V>
  void visit(V& v) {
    using config::Range;
    v("enabled", enabled, "whether every keyframe has a gain and an offset of its own");
    v("rate", rate, Range{0.0, 1.0}, "Adam's learning rate");
    v("sigma", sigma, Range{1e-6, 10.0}, "how far gains and offsets are from 1 and 0, one sigma");
  }
};

struct OnlineSection : mapping::OnlineOptions {
  template <typename V>
  void visit(V& v) {
    using config::Range;
    v("steps_per_keyframe", steps_per_keyframe, Range{0, 1000000},
      "optimisation steps when a keyframe has come, but in real time: then as many as there is "
      "time "
      "for");
    v("recent_keyframes", recent_keyframes, Range{1, 1000000}, "the newest, drawn more often");
    v("recent_share", recent_share, Range{0.0, 1.0}, "of the draws that are among these");
    v("pyramid_uses", pyramid_uses, Range{0, 1000000},
      "times that a keyframe is used at each reduced size, from mapping.coarsest on");
    v("memory_mib", memory_mib, Range{1.0, 1e9},
      "of the keyframes' images; beyond it the most redundant ones go [MiB]");
    v("heldout_views", heldout_views, Range{1, 1000000},
      "at most so many images are held out, spread over the whole run");
    v("medium_after", medium_after, Range{1, 1000000}, "keyframes before water is looked for");
    v("sparse_adam", sparse_adam,
      "as mapping.sparse_adam, while keyframes come in and after: what few of many views see stays "
      "where it is in between");
    v("keyframe_share", keyframe_share, Range{1e-6, 1.0},
      "of mapping.max_gaussians, at most so many for one keyframe; in a full map they take the "
      "place of older ones");
    v("growth_share", growth_share, Range{0.0, 1.0},
      "of the room that a keyframe finds, so much may go to cloning and splitting, which would "
      "take all of it in seconds");
    v("densify_interval", densify_interval, Range{1, 1000000},
      "while keyframes come in, a round of mapping.densify takes two keyframes' steps, its "
      "interval "
      "at least and this at most: what depth has made needs time to settle before it is judged");
    v("late_rates", late_rates, Range{0.01, 1.0},
      "part of their rates that a map's parameters learn at in the end, while it grows");
    v("late_rates_steps", late_rates_steps, Range{1, 100000000},
      "iterations after which all but 1/e of that fall is behind");
    v("drift_m", drift_m, Range{1e-6, 10.0}, "of odometry, thought possible a second [m]");
    v("drift_deg", drift_deg, Range{1e-6, 180.0}, "the same of directions [deg]");
    v("point_sigma", point_sigma, Range{0.0, 10.0},
      "of a sparse point's distance over the distance: worse ones make no Gaussian");
    v("opacity", opacity, Range{1e-3, 0.999}, "of new Gaussians");
    v("depth_lag", depth_lag, Range{0, 1000},
      "densification quadtree: keyframes that the depth of one waits for");
    v("depth_every", depth_every, Range{1, 1000}, "keyframes from one that gets depth to the next");
    v("covered_alpha", covered_alpha, Range{0.0, 1.0},
      "a block of a keyframe that the map draws so densely");
    v("covered_error", covered_error, Range{0.0, 1.0},
      "and with so small a mean error gets no Gaussian");
    v("free_space", free_space, Range{0.0, 0.95},
      "by daylight Gaussians nearer than this part of a depth that is believed behind them go; 0: "
      "none");
  }
};

/// How a map gets to agree with itself where it meets again what it has seen.
enum class Revisits {
  automatic,  ///< alignment where the rig has a lamp, else loops
  loops,      ///< features of places are met again, and the way in between is bent
  alignment,  ///< each keyframe is put where the map shows what it sees
  none,
};

struct LoopSection : loop::LoopOptions {
  template <typename V>
  void visit(V& v) {
    using config::Range;
    v("least_age_s", least_age_s, Range{10.0, 1e6},
      "nearer in time odometry knows better than a picture [s]");
    v("features", features, Range{50, 100000}, "of a picture, at most");
    v("places", places, Range{2, 1000000}, "kept at most; beyond it every second one goes");
    v("least_inliers", least_inliers, Range{6, 100000},
      "points of a place that must agree where the camera stands");
    v("pixel_sigma", pixel_sigma, Range{0.01, 100.0}, "of a feature's place in a picture [px]");
    v("drift_m", drift_m, Range{1e-6, 10.0},
      "of odometry, thought usual in the square root of a second [m]");
    v("drift_deg", drift_deg, Range{1e-6, 180.0}, "the same of its heading [deg]");
  }
};

/// The `mapping` section.
struct MappingConfig {
  bool enabled = false;
  bool medium = false;
  bool lamp = true;
  std::string initial_points = "sift";
  int initial_count = 30000;
  std::vector<double> initial_box_m;
  double initial_opacity = 0.1;
  double image_scale = 1.0;
  double report_every_s = 0.0;
  double checkpoint_every_s = 120.0;
  mapping::TrainerOptions trainer;  // the single values; its groups are the sections below
  DensifySection densify;
  RatesSection rates;
  PoseSection poses;
  ExposureSection exposure;
  bool use_dvl_ranges = false;
  OnlineSection online;
  Revisits revisits = Revisits::automatic;
  LoopSection loops;
  DepthSection depth;

  template <typename V>
  void visit(V& v) {
    using config::Choices;
    using config::Range;
    using mapping::Densification;
    v("enabled", enabled, "whether a map is made");
    v("densification", densify.kind,
      Choices<Densification>{{"none", Densification::none},
                             {"gradient", Densification::gradient},
                             {"random", Densification::random},
                             {"quadtree", Densification::quadtree}},
      "how the map grows");
    v("medium", medium, "whether the water's colour and attenuation are estimated too");
    v("lamp", lamp,
      "whether with the water the light of the rig's lamp0 is estimated, if it has one");
    v("max_gaussians", densify.max_gaussians, Range{0, 100000000},
      "the map grows no larger; 0: as suits the device, 100,000 on a CPU and 600,000 on a GPU; "
      "where a GPU's memory ends, less");
    v("iterations", trainer.iterations, Range{0, 100000000}, "optimisation steps, given poses");
    v("final_iterations", trainer.final_iterations, Range{0, 100000000},
      "more of them at the end, without growth and at falling rates");
    v("time_budget_s", trainer.time_budget_s, Range{0.0, 1e9},
      "at most this long; rates and growth are spread over it; with localization, of the steps at "
      "the end; 0 for no limit [s]");
    v("initial_points", initial_points,
      "sift (matched and triangulated), random, or a file: PLY or COLMAP's points3D.txt");
    v("initial_count", initial_count, Range{1, 100000000}, "of random points");
    v("initial_box_m", initial_box_m,
      "where random points are: x, y, z of its low and of its high corner; empty: around the "
      "cameras [m]");
    v("initial_opacity", initial_opacity, Range{1e-4, 0.999}, "of the first Gaussians");
    v("image_scale", image_scale, Range{1e-3, 1.0}, "size of the images used over that recorded");
    v("coarsest", trainer.coarsest, Range{1, 8}, "the training begins with images reduced by this");
    v("coarse_until", trainer.coarse_until, Range{0.0, 1.0},
      "part of the training after which they are whole");
    v("sh_degree", trainer.sh_degree, Range{0, mapping::kMostShDegree},
      "of the spherical harmonics: how colours change with direction");
    v("sh_interval", trainer.sh_interval, Range{1, 100000000}, "iterations until one degree more");
    v("ssim_weight", trainer.ssim_weight, Range{0.0, 1.0}, "of D-SSIM in the loss; the rest is L1");
    v("smoothness", trainer.smoothness, Range{0.0, 1000.0},
      "how much surfaces keep from bending where pictures are even, as sand in the dark; 0: not at "
      "all");
    v("antialiased", trainer.antialiased, "whether small Gaussians fade as they are smoothed");
    v("auto_gain", trainer.auto_gain,
      "whether each keyframe's picture is brighter or darker as a whole than the map, as a "
      "camera's "
      "that exposes by itself; held-out images get what lies between their neighbours");
    v("sparse_adam", trainer.sparse_adam,
      "a step changes only the Gaussians that its view sees: faster, a little worse a step");
    v("densify", densify, "growth and pruning");
    v("rates", rates, "Adam's learning rates");
    v("poses", poses, "correction of poses; with localization, at the end");
    v("exposure", exposure, "correction of exposure");
    v("use_dvl_ranges", use_dvl_ranges,
      "with localization: whether what the DVL's beams met makes Gaussians too");
    v("online", online, "with localization: a map that grows as keyframes come");
    v("revisits", revisits,
      Choices<Revisits>{{"auto", Revisits::automatic},
                        {"loops", Revisits::loops},
                        {"alignment", Revisits::alignment},
                        {"none", Revisits::none}},
      "with localization, so that what is met again is not drawn a second time where odometry has "
      "drifted to: loops bends the way between, alignment puts the keyframe where the map shows "
      "what it sees; auto: alignment where the rig has a lamp, whose light moves along and makes a "
      "place look another, else loops");
    v("loops", loops, "revisits loops: places that are met again");
    v("depth", depth, "densification quadtree: depth of keyframes");
    v("report_every_s", report_every_s, Range{0.0, 1e9},
      "writes the held-out images' PSNR to mapping.csv this often; 0: never [s]");
    v("checkpoint_every_s", checkpoint_every_s, Range{0.0, 1e9},
      "saves what a later run resumes from this often; 0: at the end only [s]");
  }
};

/// Everything about a run, as in a configuration file: localization's part and mapping's.
struct RunConfig : pipeline::RunConfig {
  MappingConfig mapping;

  template <typename V>
  void visit(V& v) {
    pipeline::RunConfig::visit(v);
    v("mapping", mapping, "the map of Gaussians");
  }
};

/// What the trainer is told: the sections in one, with the run's seed.
mapping::TrainerOptions trainer_options(const RunConfig& config, const Rig& rig = {});

/// `mapping.max_gaussians`, or what suits the device that maps are made on.
int most_gaussians(const RunConfig& config);

/// What `mapping.revisits: auto` means for a rig.
Revisits revisits_of(const RunConfig& config, const Rig& rig);

/// The same for a map that grows while poses are estimated.
mapping::MapperOptions mapper_options(const RunConfig& config, const Rig& rig = {});

/// Reads a configuration file with what it inherits, then the overrides "key=value" in order, and
/// checks what single keys cannot say. Throws InputError.
RunConfig load_run_config(const std::filesystem::path& file,
                          const std::vector<std::string>& overrides);

}  // namespace apvi::bridge
