// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/types.h>

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <vector>

#include "apvi/mapping/densify.hpp"
#include "apvi/mapping/keyframe_store.hpp"
#include "apvi/mapping/options.hpp"
#include "apvi/mapping/view_corrections.hpp"
#include "apvi/splat/gaussian_store.hpp"
#include "apvi/splat/medium_optimizer.hpp"
#include "apvi/splat/render.hpp"

namespace apvi::mapping {

/// Makes a map of keyframes that are all there from the start. One thread; every call of `step` is
/// one iteration, so the caller decides when to look, save or stop. Without a time budget the same
/// map comes out of the same options to the bit, also through `save` and `resume`.
class Trainer {
 public:
  /// `keyframes` must outlive the trainer. With `medium`, the map is seen through water that is
  /// learnt too, from there. Throws c10::Error when there is nothing to learn from.
  Trainer(const KeyframeStore& keyframes, const splat::Gaussians& initial,
          const TrainerOptions& options, const std::optional<splat::Medium>& medium = std::nullopt);

  /// Goes on from what `save` left, with the same keyframes and options. Throws InputError when the
  /// file is damaged, or of other keyframes.
  void resume(const std::filesystem::path& checkpoint);
  /// Everything that `resume` needs, in one step. Throws RunError when it cannot be written.
  void save(const std::filesystem::path& checkpoint) const;

  bool done() const;
  /// One iteration; returns its loss.
  double step();
  /// How far the training is, 0 to 1; by iterations or by time, whichever is further.
  double progress() const;
  std::int64_t iteration() const { return iteration_; }
  /// Time spent in `step` so far, also before a `resume` [s].
  double seconds() const { return seconds_; }

  /// The map as it is; shares memory with the trainer's.
  splat::Gaussians map() const;
  std::int64_t size() const { return store_.size(); }
  std::optional<splat::Medium> medium() const;
  const ViewCorrections& corrections() const { return corrections_; }

 private:
  std::size_t choose_view() const;
  int reduction() const;
  splat::RenderOptions render_options() const;
  splat::GaussianRates rates() const;
  torch::Tensor image_of(std::size_t view, const splat::View& camera,
                         const splat::RenderOutput& out);
  void maybe_densify();
  void insert_random();

  const KeyframeStore& keyframes_;
  TrainerOptions options_;
  double extent_;
  std::int64_t initial_size_;
  splat::GaussianStore store_;
  DensityStatistics statistics_;
  ViewCorrections corrections_;
  std::optional<splat::MediumOptimizer> medium_;
  std::int64_t iteration_ = 0;
  double seconds_ = 0.0;
};

}  // namespace apvi::mapping
