// SPDX-License-Identifier: BSD-3-Clause
#pragma once

/// Numbers that every backend of a training step must agree on; no LibTorch here.
namespace apvi::mapping::step {

inline constexpr double kSolid = 0.5;  ///< alpha from which a pixel is a surface
inline constexpr double kLeastDivisor = 1e-6;

// Gains
inline constexpr double kSaturated = 0.98;   ///< a channel that bright tells nothing of more
inline constexpr double kLeastShare = 0.1;   ///< of the colours must be compared
inline constexpr double kLeastLight = 0.02;  ///< mean of what is drawn
inline constexpr double kLeastGain = 1e-3;
inline constexpr double kUsualGain = 0.1;  ///< of a logarithm: what differs more tells no more
inline constexpr double kOpenGain = 0.2;   ///< of a logarithm: open water is not farther off
inline constexpr double kOpenSay = 5.0;    ///< of a pixel of open water over one of a surface's
inline constexpr double kSkySay = 200.0;   ///< above the horizon, where far ground is no mistake

// Open water
inline constexpr int kOpenSquare = 5;          ///< [px]
inline constexpr double kOpenOffset = 0.01;    ///< of a colour
inline constexpr double kOpenRelative = 0.06;  ///< the same over the water's
inline constexpr double kOpenTexture = 0.03;   ///< standard deviation over the square, noise and a
                                               ///< grain or two
inline constexpr int kBesideOpen = 3;          ///< [px] to each side: what is so near is an edge

// Bentness
inline constexpr int kBendReach = 6;          ///< [px] of a second difference, to each side
inline constexpr double kBendNearest = 1e-3;  ///< [m]
inline constexpr double kBendEdge = 0.05;  ///< second difference of a grey level (0 to 1): an edge
inline constexpr double kBendGap = 0.02;   ///< of what is solid: what ends there is not bent

}  // namespace apvi::mapping::step
