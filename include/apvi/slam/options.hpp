// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "apvi/config/fields.hpp"
#include "apvi/depth/options.hpp"
#include "apvi/localization/options.hpp"
#include "apvi/loop_closure/options.hpp"
#include "apvi/mapping/options.hpp"

namespace apvi::slam {

/// How the map is corrected when the vehicle returns to a mapped place.
enum class LoopClosureMethod {
  automatic,   ///< pose_graph; without the graph of the trajectory, alignment if there is a lamp
  pose_graph,  ///< follows the pose graph of the trajectory; without one, a graph of its own
  alignment,   ///< each keyframe is aligned to the map photometrically
  none,
};

struct LoopClosureOptions : loop_closure::LoopOptions {
  LoopClosureMethod method = LoopClosureMethod::automatic;

  template <typename V>
  void visit(V& v) {
    v("method", method,
      config::Choices<LoopClosureMethod>{{"auto", LoopClosureMethod::automatic},
                                         {"pose_graph", LoopClosureMethod::pose_graph},
                                         {"alignment", LoopClosureMethod::alignment},
                                         {"none", LoopClosureMethod::none}},
      "pose_graph: follow the pose graph of the trajectory (smoothing), or without one close loops "
      "in a graph of the map's own, by the keys below; alignment: align each keyframe to the map "
      "photometrically; auto: pose_graph, but alignment if the rig has a lamp and the trajectory "
      "no pose graph");
    loop_closure::LoopOptions::visit(v);
  }
};

/// Whether a map is built.
enum class MapSwitch {
  automatic,  ///< if there is a camera, and this build has LibTorch
  on,
  off,
};

/// The map: what is built, from what, and how.
struct MappingOptions {
  MappingOptions() { trainer.densify.kind = mapping::Densification::quadtree; }

  MapSwitch enabled = MapSwitch::automatic;
  bool medium = true;
  bool lamp = true;
  std::string initial_points = "sift";
  int initial_random_points = 30000;
  std::vector<double> initial_box_m;
  double initial_opacity = 0.1;
  double image_scale = 1.0;
  double report_every_s = 0.0;
  double checkpoint_every_s = 120.0;
  mapping::TrainerOptions trainer;
  bool use_dvl_ranges = false;
  mapping::OnlineOptions online;
  LoopClosureOptions loop_closure;
  depth::DepthOptions depth;
  /// Where parts of a large map go that memory does not hold (no key); empty: nowhere. `apvi run`
  /// takes a folder in its run folder.
  std::filesystem::path storage_folder;

  template <typename V>
  void visit(V& v) {
    using config::Choices;
    using config::Range;
    using mapping::Densification;
    using mapping::MediumEstimationMethod;
    v("enabled", enabled,
      Choices<MapSwitch>{
          {"auto", MapSwitch::automatic}, {"true", MapSwitch::on}, {"false", MapSwitch::off}},
      "build a map; auto: if the recording has camera images");
    v("densification", trainer.densify.kind,
      Choices<Densification>{{"none", Densification::none},
                             {"gradient", Densification::gradient},
                             {"random", Densification::random},
                             {"quadtree", Densification::quadtree}},
      "source of new Gaussians: none; gradient: clone and split; random: also at random pixels; "
      "quadtree: also from depth estimation; with given poses the default is gradient");
    v("medium", medium, "estimate attenuation and backscatter of the water");
    v("medium_estimation", trainer.medium_estimation,
      Choices<MediumEstimationMethod>{{"fit", MediumEstimationMethod::fit},
                                      {"gradient", MediumEstimationMethod::gradient}},
      "fit: fits to surfaces that the map shows at several ranges; gradient: optimized with the "
      "map, at twice the learning rate while VIO fails, without a lamp (the paper)");
    v("lamp", lamp, "with medium: model the light of the rig's lamps if it has any");
    v("max_gaussians", trainer.densify.max_gaussians, Range{0, 100000000},
      "maximum number of Gaussians on the device; 0: 100,000 on a CPU, 600,000 on a GPU; fewer if "
      "GPU memory runs out");
    v("iterations", trainer.iterations, Range{0, 100000000}, "optimization steps; given poses");
    v("final_iterations", trainer.final_iterations, Range{0, 100000000},
      "additional optimization steps at the end, without densification, at decaying learning "
      "rates; null: 5,000 with localization on a GPU unless in realtime mode, otherwise none");
    v("time_budget_s", trainer.time_budget_s, Range{0.0, 1e9},
      "time limit of the optimization, over which schedules are stretched; with localization: of "
      "the final iterations; 0: none [s]");
    v("initial_points", initial_points,
      "sift (matched and triangulated), random, or a file: PLY or COLMAP's points3D.txt");
    v("initial_random_points", initial_random_points, Range{1, 100000000},
      "number of random points");
    v("initial_box_m", initial_box_m,
      "bounds of random points, [x, y, z, x, y, z], minimum first; empty: around the cameras [m]");
    v("initial_opacity", initial_opacity, Range{1e-4, 0.999}, "opacity of initial Gaussians");
    v("image_scale", image_scale, Range{1e-3, 1.0},
      "size of the images used relative to the recorded ones");
    v("initial_downscale", trainer.initial_downscale, Range{1, 8},
      "image downscaling factor at the start of the optimization: 1, 2, 4 or 8");
    v("full_resolution_after", trainer.full_resolution_after, Range{0.0, 1.0},
      "fraction of the optimization after which images have full resolution");
    v("sh_degree", trainer.sh_degree, Range{0, mapping::kShDegreeLimit},
      "degree of the spherical harmonics (view-dependent color)");
    v("sh_degree_interval", trainer.sh_degree_interval, Range{1, 100000000},
      "steps until the next degree is used");
    v("ssim_weight", trainer.ssim_weight, Range{0.0, 1.0},
      "weight of D-SSIM in the loss; the rest is L1");
    v("robust_weights", trainer.robust_weights, "lower the weight of what moves, such as fish");
    v("depth_curvature_weight", trainer.depth_curvature_weight, Range{0.0, 1000.0},
      "weight of the depth curvature loss in regions with little texture; 0: none");
    v("antialiased", trainer.antialiased,
      "reduce the opacity of Gaussians smaller than a pixel (antialiasing)");
    v("tone_curve", trainer.tone_curve, "tone curve of the camera");
    v("gain_compensation", trainer.gain_compensation,
      "estimate a brightness gain per keyframe, for cameras with automatic exposure; held-out "
      "images interpolate their neighbors'");
    v("sparse_adam", trainer.sparse_adam,
      "update only the Gaussians visible in the view: faster steps, slightly less progress per "
      "step; null: false with given poses, online.sparse_adam with localization");
    v("densify", trainer.densify, "densification and pruning");
    v("learning_rates", trainer.learning_rates, "learning rates of Adam");
    v("pose_refinement", trainer.pose_refinement,
      "pose refinement; with localization: in the final iterations");
    v("exposure_correction", trainer.exposure_correction, "exposure correction");
    v("use_dvl_ranges", use_dvl_ranges,
      "with localization: also initialize Gaussians where DVL beams hit");
    v("online", online, "with localization: incremental mapping");
    v("loop_closure", loop_closure, "with localization: loop closure");
    v("depth", depth, "densification quadtree: depth estimation of keyframes");
    v("report_every_s", report_every_s, Range{0.0, 1e9},
      "interval at which the PSNR of held-out images is written to mapping.csv; 0: never [s]");
    v("checkpoint_every_s", checkpoint_every_s, Range{0.0, 1e9},
      "interval of checkpoints, at least 20 times the time to write one; 0: at the end only [s]");
  }

  /// Throws InputError for contradictory values.
  void check() const;
};

/// Localization and mapping.
struct Options {
  localization::Options localization;
  MappingOptions mapping;

  /// Throws InputError for contradictory values.
  void check() const;
};

}  // namespace apvi::slam
