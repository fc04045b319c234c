// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <optional>
#include <vector>

#include "apvi/fusion/degeneracy.hpp"

namespace apvi::fusion {

/// Lower edge μ - 2 σ sqrt(N) of the eigenvalues of a random symmetric N x N matrix with mean μ on
/// its diagonal and standard deviation σ off it (Wigner; Benaych-Georges and Knowles, "Lectures on
/// the local semicircle law", 2016).
double wigner_lower_edge(double mean, double sigma, int size);

/// Eigenvalues of one block over healthy runs, and the semicircle with their mean and deviation: a
/// semicircle of radius ρ has standard deviation ρ/2, so that 2 σ sqrt(N) is twice the standard
/// deviation of the eigenvalues themselves.
struct Semicircle {
  double mean = 0.0;       ///< of the values, or of their decadic logarithm
  double deviation = 0.0;  ///< the same; the radius is twice that
  bool logarithmic = false;
  double lower_edge = 0.0;  ///< a threshold for eigenvalues, never a logarithm
  double misfit = 0.0;  ///< largest difference of the distribution functions (Kolmogorov-Smirnov)
  double share_below = 0.0;  ///< of the samples that the edge would reject
  std::size_t count = 0;     ///< samples used
};

/// The distribution function of a semicircle.
double semicircle_cdf(double x, double mean, double radius);

/// Fits the values as they are, or their logarithms. Values that are not finite are left out, and
/// for the logarithm those that are not positive. Nothing for fewer than two different values.
std::optional<Semicircle> fit_semicircle(const std::vector<double>& values, bool logarithmic);

/// Both blocks of recorded eigenvalues, each in the way that fits better. Eigenvalues of real runs
/// spread over decades and are skewed, which puts the edge of the plain values below zero, where it
/// rejects nothing: then the logarithms are taken whatever the misfit.
struct ThresholdFit {
  Semicircle rotation;
  Semicircle position;
  EigenThresholds thresholds() const { return {rotation.lower_edge, position.lower_edge}; }
};
std::optional<ThresholdFit> fit_semicircle(const std::vector<Eigenvalues>& samples);

}  // namespace apvi::fusion
