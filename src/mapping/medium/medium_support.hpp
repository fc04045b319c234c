// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>

namespace torch::serialize {
class InputArchive;
class OutputArchive;
}  // namespace torch::serialize

namespace apvi::mapping {

/// Whether the images show that there is a medium.
///
/// In air, with all surfaces at one range, or in images without color, a medium explains the images
/// no better than surface colors alone; a map with one would only be worse. So a map gets a medium
/// when it explains a clear part of what surface colors leave unexplained, however many
/// observations there are.
class MediumSupport {
 public:
  /// Adds an estimation: by how much its medium lowers the deviance (medium::MediumFit::deviance)
  /// of so many observations.
  void add(double saved_deviance, std::int64_t observations);
  /// Whether to use a medium.
  bool is_sufficient() const;
  /// Means over the estimations; earlier ones decay, because the map improves.
  double saved_deviance() const;
  double saved_per_observation() const;

  void save(torch::serialize::OutputArchive& archive) const;
  void load(torch::serialize::InputArchive& archive);

 private:
  double sum_ = 0.0;
  double observations_ = 0.0;
  double weight_ = 0.0;
};

}  // namespace apvi::mapping
