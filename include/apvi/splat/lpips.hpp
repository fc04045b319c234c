// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/types.h>

#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace apvi::splat {

/// The network whose features are compared; numbers of different ones do not compare.
enum class LpipsNet { alex, vgg };
/// "AlexNet" or "VGG-16", for tables.
std::string_view net_name(LpipsNet net);

/// What to say where the number would stand when the weights are not there.
inline constexpr std::string_view kLpipsAbsent = "n/a, run scripts/make_lpips_weights.py";

/// Where the weights are looked for: $APVI_LPIPS, else $XDG_DATA_HOME/apvi, else
/// ~/.local/share/apvi; in it `lpips_alex.bin` and `lpips_vgg.bin`.
std::filesystem::path lpips_folder();

/// How unlike two images look to people, 0 when they are the same (Zhang et al., "The unreasonable
/// effectiveness of deep features as a perceptual metric", 2018), version 0.1 of its weights.
class Lpips {
 public:
  /// Nothing when the file is not there: the metric is absent then. Throws InputError when it is
  /// no such file.
  static std::optional<Lpips> load(LpipsNet net,
                                   const std::filesystem::path& folder = lpips_folder());

  LpipsNet net() const { return net_; }
  /// Of images [H,W,3] in [0, 1], of 32 pixels or more a side. float32, on any device. Throws
  /// c10::Error for other shapes.
  double operator()(const torch::Tensor& a, const torch::Tensor& b) const;

 private:
  Lpips(LpipsNet net, std::vector<torch::Tensor> tensors);

  LpipsNet net_;
  std::vector<torch::Tensor> tensors_;  ///< weight and bias of the convolutions, linear layers
};

}  // namespace apvi::splat
