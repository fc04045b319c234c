// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/types.h>

#include <array>
#include <cstdint>
#include <vector>

#include "apvi/splat/adam.hpp"
#include "apvi/splat/gaussians.hpp"
#include "apvi/splat/similarity.hpp"

namespace torch::serialize {
class InputArchive;
class OutputArchive;
}  // namespace torch::serialize

namespace apvi::splat {

/// Adam's learning rates, one for each kind of parameter, as Gaussian splatting starts with (Kerbl
/// et al., 2023).
struct GaussianRates {
  double means = 1.6e-4;  ///< [m]: times the extent of the scene
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

/// A map that is being learnt: the Gaussians with Adam's memory of each, in buffers that are larger
/// than needed, so that a map may grow and shrink all the time without being copied every time.
/// Where a device's memory ends, c10::Error is thrown and the map is as it was.
class GaussianStore {
 public:
  static constexpr std::int64_t kNobody = -1;

  /// Takes a copy of the Gaussians. Throws c10::Error when their tensors do not fit together.
  explicit GaussianStore(const Gaussians& gaussians);

  std::int64_t size() const { return size_; }
  std::int64_t capacity() const { return anchors_.defined() ? anchors_.size(0) : 0; }
  /// Steps of Adam made so far.
  std::int64_t steps() const { return steps_; }

  /// The Gaussians there are: leaves that require a gradient and share the store's memory; the same
  /// tensors at every call, until `insert`, `prune`, `transform` or `load` makes them stale.
  const Gaussians& view() const;

  /// Whom each Gaussian belongs to [size()] int64, for example the keyframe that saw it first: what
  /// moves moves its own. kNobody without one.
  torch::Tensor anchors() const;

  /// Adds Gaussians of the same degree and type behind the others, without momentum. `anchors`
  /// [gaussians.size()] int64; undefined: nobody's.
  void insert(const Gaussians& gaussians, const torch::Tensor& anchors = {});
  /// Removes those where `remove` [size()] (bool) is set. The others keep their order and momentum.
  void prune(const torch::Tensor& remove);

  /// Puts Gaussian order[i] at place i, with all that belongs to it. Throws c10::Error where
  /// `order` [size()] (int64) does not fit.
  void reorder(const torch::Tensor& order);

  /// Moves everything to a device, without room to spare. Where its memory ends the rest stays
  /// where it was, and can be saved.
  void to(const torch::Device& device);

  /// One step of Adam with the gradients that a backward pass left in `view()`; takes them away.
  /// `visible` as in `adam_step`.
  void step(const GaussianRates& rates, const AdamOptions& options = {},
            const torch::Tensor& visible = {});
  /// The same with what a picture left in `RenderOutput::rows`; with `visible_only`, Gaussians that
  /// it does not show stay as they are.
  void step(const GaussianRates& rates, const GaussianRows& rows, bool visible_only,
            const AdamOptions& options = {});
  /// Lets Adam forget the Gaussians where `which` [size()] (bool) is set, because they were put
  /// elsewhere.
  void forget_momentum(const torch::Tensor& which);
  /// Lowers every opacity to `highest` at most, without momentum: what is needed grows again.
  void reset_opacity(double highest);
  /// Moves each Gaussian by the motion that `which` [size()] (int64) says; -1: it stays. Momentum
  /// stays as it is: it is of the next few steps only, and corrections turn little.
  void transform(const Similarities& similarities, const torch::Tensor& which);

  /// Everything, to the bit.
  void save(torch::serialize::OutputArchive& archive) const;
  /// In the computer's own memory. Throws c10::Error when the archive holds no map, or one whose
  /// tensors do not fit together.
  static GaussianStore load(torch::serialize::InputArchive& archive);

 private:
  void reserve(std::int64_t count);
  void take(const torch::Tensor& rows);
  std::vector<AdamGroup> groups(const GaussianRates& rates) const;

  std::int64_t size_ = 0;
  std::int64_t steps_ = 0;
  Gaussians parameters_;  ///< these and the next two have capacity() rows
  Gaussians first_;
  Gaussians second_;
  torch::Tensor anchors_;   ///< [capacity()] int64
  mutable Gaussians view_;  ///< empty when stale
};

}  // namespace apvi::splat
