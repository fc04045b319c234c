// SPDX-License-Identifier: BSD-3-Clause
#pragma once

/// Constants shared by all backends of a training step; without LibTorch.
namespace apvi::mapping::step {

inline constexpr double kSolid = 0.5;  ///< alpha from which a pixel is a surface
inline constexpr double kMinDivisor = 1e-6;

// Gains
inline constexpr double kSaturated = 0.98;           ///< channels at least this bright are clipped
inline constexpr double kMinComparedFraction = 0.1;  ///< of the values
inline constexpr double kMinMeanLight = 0.02;        ///< of the compared rendering
inline constexpr double kMinGain = 1e-3;
inline constexpr double kMaxLogGainBiasError = 0.1;       ///< bound of a single bias update
inline constexpr double kMaxOpenWaterLogGainError = 0.2;  ///< bound for open water
inline constexpr double kOpenWaterWeight = 5.0;           ///< relative to a surface pixel
inline constexpr double kSkyWeight = 200.0;  ///< above the horizon, where no surface is possible

// Open water
inline constexpr int kOpenWaterWindow = 5;              ///< [px]
inline constexpr double kOpenWaterAbsTolerance = 0.01;  ///< of a color
inline constexpr double kOpenWaterRelTolerance = 0.06;  ///< relative to the water's color
inline constexpr double kOpenWaterMaxStddev = 0.03;  ///< in the window; allows noise and particles
inline constexpr int kOpenWaterMargin = 3;           ///< [px] to each side, treated as an edge

// Depth curvature loss
inline constexpr int kCurvatureReach = 6;           ///< [px] to each side
inline constexpr double kCurvatureMinDepth = 1e-3;  ///< [m]
inline constexpr double kCurvatureEdge = 0.05;  ///< second difference of gray (0 to 1) at an edge
inline constexpr double kCurvatureGap = 0.02;   ///< second difference of coverage at a silhouette

}  // namespace apvi::mapping::step
