// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <optional>
#include <vector>

#include "fusion/degeneracy.hpp"

namespace apvi::fusion {

/// Lower edge μ - 2 σ sqrt(N) of the spectrum of a random symmetric N x N matrix with mean μ on its
/// diagonal and standard deviation σ off it (Wigner semicircle law; Benaych-Georges and Knowles,
/// "Lectures on the local semicircle law", 2016).
double wigner_lower_edge(double mean, double sigma, int size);

/// A semicircle distribution with the mean and standard deviation of the eigenvalues of one block
/// over healthy runs. The paper sets its degeneracy thresholds at the lower edge of this
/// distribution. A semicircle of radius ρ has standard deviation ρ/2, so 2 σ sqrt(N) is twice the
/// standard deviation of the eigenvalues.
struct Semicircle {
  double mean = 0.0;       ///< mean of the values, or of their base-10 logarithms
  double deviation = 0.0;  ///< standard deviation; the radius is twice that
  bool logarithmic = false;
  double lower_edge = 0.0;   ///< threshold for the eigenvalues, never a logarithm
  double misfit = 0.0;       ///< Kolmogorov-Smirnov distance
  double share_below = 0.0;  ///< fraction of samples below the edge
  std::size_t count = 0;     ///< number of samples used
};

/// Cumulative distribution function of a semicircle.
double semicircle_cdf(double x, double mean, double radius);

/// Fits the values or their logarithms. Ignores non-finite values and, for logarithms, non-positive
/// ones. Nullopt for fewer than two distinct values.
std::optional<Semicircle> fit_semicircle(const std::vector<double>& values, bool logarithmic);

/// Fits of both blocks, each linear or logarithmic, whichever fits better. Recorded eigenvalues
/// span decades and are skewed; if the edge of the linear fit is not positive and would reject
/// nothing, the logarithmic fit is used regardless of the misfit.
struct ThresholdFit {
  Semicircle rotation;
  Semicircle position;
  EigenThresholds thresholds() const { return {rotation.lower_edge, position.lower_edge}; }
};
std::optional<ThresholdFit> fit_semicircle(const std::vector<Eigenvalues>& samples);

}  // namespace apvi::fusion
