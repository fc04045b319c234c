// SPDX-License-Identifier: BSD-3-Clause
#pragma once

namespace torch::serialize {
class InputArchive;
class OutputArchive;
}  // namespace torch::serialize

namespace apvi::mapping {

/// Whether the images show that there is a medium.
///
/// In air, with all surfaces at one range, or in images without color, a medium explains the images
/// no better than surface colors alone; a map with one would only be worse. So a map gets a medium
/// when the fit with it has a clearly smaller deviance.
class MediumSupport {
 public:
  /// Adds an estimation: by how much its medium lowers the deviance (medium::MediumFit::deviance).
  void add(double saved_deviance);
  /// Whether to use a medium.
  bool is_sufficient() const;
  /// Mean over the estimations; earlier ones decay, because the map improves.
  double saved_deviance() const;

  void save(torch::serialize::OutputArchive& archive) const;
  void load(torch::serialize::InputArchive& archive);

 private:
  double sum_ = 0.0;
  double weight_ = 0.0;
};

}  // namespace apvi::mapping
