// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/types.h>

#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace apvi::gaussians {

/// Feature network; values of different networks are not comparable.
enum class LpipsNet { alex, vgg };
/// "AlexNet" or "VGG-16", for tables.
std::string_view net_name(LpipsNet net);

/// Printed instead of the value when the weights are not installed.
inline constexpr std::string_view kLpipsUnavailable = "n/a, run scripts/make_lpips_weights.py";

/// Folder of the weights: $APVI_LPIPS, else $XDG_DATA_HOME/apvi, else ~/.local/share/apvi; with
/// `lpips_alex.bin` and `lpips_vgg.bin`.
std::filesystem::path lpips_folder();

/// Learned perceptual image patch similarity, 0 for equal images (Zhang et al., "The unreasonable
/// effectiveness of deep features as a perceptual metric", 2018), weights of version 0.1.
class Lpips {
 public:
  /// Nothing when the file does not exist. Throws InputError when it is not a valid weight file.
  static std::optional<Lpips> load(LpipsNet net,
                                   const std::filesystem::path& folder = lpips_folder());

  LpipsNet net() const { return net_; }
  /// Distance of images [H,W,3] in [0, 1], at least 32 px on each side. float32, on any device.
  /// Throws c10::Error for other shapes.
  double operator()(const torch::Tensor& a, const torch::Tensor& b) const;

 private:
  Lpips(LpipsNet net, std::vector<torch::Tensor> tensors);

  LpipsNet net_;
  std::vector<torch::Tensor> tensors_;  ///< convolution weights and biases, then linear layers
};

}  // namespace apvi::gaussians
