// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/types.h>

#include <array>
#include <cstdint>
#include <vector>

#include "gaussians/model/gaussians.hpp"
#include "gaussians/model/similarity.hpp"
#include "gaussians/optimizer/adam.hpp"

namespace torch::serialize {
class InputArchive;
class OutputArchive;
}  // namespace torch::serialize

namespace apvi::gaussians {

/// Adam learning rates per kind of parameter; initial values as in Gaussian splatting (Kerbl et
/// al., 2023).
struct GaussianLearningRates {
  double means = 1.6e-4;  ///< [m]: multiplied by the extent of the scene
  double log_scales = 5e-3;
  double quaternions = 1e-3;
  double logit_opacities = 5e-2;
  double sh_dc = 2.5e-3;
  double sh_rest = 1.25e-4;

  /// In the order of Gaussians::tensors().
  std::array<double, 6> values() const {
    return {means, log_scales, quaternions, logit_opacities, sh_dc, sh_rest};
  }
};

/// Gaussians taken out of a store, in host memory.
struct GaussianRows {
  Gaussians parameters;
  Gaussians first, second;  ///< Adam moments
  torch::Tensor anchors;    ///< [n] int64

  std::int64_t size() const { return parameters.size(); }
  std::int64_t bytes() const;
};

/// A map under optimization: Gaussians and their Adam moments in buffers with spare capacity, so
/// that insertion and pruning rarely reallocate. When the device runs out of memory, c10::Error is
/// thrown and the map is unchanged.
class GaussianStore {
 public:
  static constexpr std::int64_t kNoAnchor = -1;

  /// Copies the Gaussians. Throws c10::Error when their tensors do not match.
  explicit GaussianStore(const Gaussians& gaussians);

  std::int64_t size() const { return size_; }
  std::int64_t capacity() const { return anchors_.defined() ? anchors_.size(0) : 0; }
  /// Number of Adam steps so far.
  std::int64_t steps() const { return steps_; }

  /// The current Gaussians: leaf tensors that require a gradient and share the store's memory; the
  /// same tensors at every call, until `insert`, `prune`, `transform` or `load` invalidates them.
  const Gaussians& view() const;

  /// Anchor of each Gaussian [size()] int64, e.g. the keyframe that inserted it: Gaussians move
  /// with their anchor when its pose is corrected. kNoAnchor if it has none.
  torch::Tensor anchors() const;

  /// Appends Gaussians of the same degree and type, with zero moments. `anchors` [gaussians.size()]
  /// int64; undefined: kNoAnchor.
  void insert(const Gaussians& gaussians, const torch::Tensor& anchors = {});
  /// Removes the Gaussians where `remove` [size()] (bool) is set. The others keep their order and
  /// moments.
  void prune(const torch::Tensor& remove);
  /// Removes the Gaussians where `which` [size()] (bool) is set and returns them.
  GaussianRows take(const torch::Tensor& which);
  /// Appends what `take` returned.
  void put(const GaussianRows& rows);

  /// Moves Gaussian order[i], with its moments and anchor, to position i. Throws c10::Error when
  /// `order` [size()] (int64) does not match.
  void reorder(const torch::Tensor& order);

  /// Moves everything to a device and drops the spare capacity. When the device runs out of memory
  /// the remaining tensors stay where they were, and the map can still be saved.
  void to(const torch::Device& device);

  /// One Adam step with the gradients of `view()`, which are then cleared. `visible` as in
  /// `adam_step`.
  void step(const GaussianLearningRates& rates, const AdamOptions& options = {},
            const torch::Tensor& visible = {});
  /// The same with a sparse gradient (`RenderOutput::sparse_gradient`); with `visible_only`,
  /// Gaussians not visible in that image are left unchanged.
  void step(const GaussianLearningRates& rates, const SparseGradient& gradient, bool visible_only,
            const AdamOptions& options = {});
  /// Zeroes the moments of the Gaussians where `which` [size()] (bool) is set, after they were
  /// moved.
  void reset_momentum(const torch::Tensor& which);
  /// Clamps every opacity to `highest` and zeroes its moments; the optimizer raises those that are
  /// needed.
  void reset_opacity(double highest);
  /// Applies transform number `which` [size()] (int64) to each Gaussian; -1: unchanged. Moments are
  /// kept: they decay within a few steps and corrections rotate little.
  void transform(const SimilarityTransforms& similarities, const torch::Tensor& which);

  /// Saves everything, bitwise.
  void save(torch::serialize::OutputArchive& archive) const;
  /// Loads into CPU memory. Throws c10::Error when the archive holds no map, or tensors that do not
  /// match.
  static GaussianStore load(torch::serialize::InputArchive& archive);

 private:
  void reserve(std::int64_t count);
  /// With zero moments where they are null.
  void append(const Gaussians& gaussians, const torch::Tensor& anchors, const Gaussians* first,
              const Gaussians* second);
  void keep_rows(const torch::Tensor& rows);
  std::vector<AdamGroup> groups(const GaussianLearningRates& rates) const;

  std::int64_t size_ = 0;
  std::int64_t steps_ = 0;
  Gaussians parameters_;  ///< these and the moments have capacity() rows
  Gaussians first_;
  Gaussians second_;
  torch::Tensor anchors_;   ///< [capacity()] int64
  mutable Gaussians view_;  ///< empty when invalidated
};

}  // namespace apvi::gaussians
