// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "gaussians/render/splat_math.hpp"

/// View-dependent color: real spherical harmonics up to degree 3, in the order and with the signs
/// of 3D Gaussian splatting files. T is a scalar or a vector of scalars.
namespace apvi::gaussians {

inline constexpr double kSh0 = 0.28209479177387814;
inline constexpr double kSh1 = 0.4886025119029199;
inline constexpr double kSh2a = 1.0925484305920792;
inline constexpr double kSh2b = 0.31539156525252005;
inline constexpr double kSh2c = 0.5462742152960396;
inline constexpr double kSh3a = 0.5900435899266435;
inline constexpr double kSh3b = 2.890611442640554;
inline constexpr double kSh3c = 0.4570457994644658;
inline constexpr double kSh3d = 0.3731763325901154;
inline constexpr double kSh3e = 1.445305721320277;

inline constexpr int kMaxShRest = 15;
/// Coefficients per channel beyond the constant one, for a degree.
APVI_HD constexpr int sh_rest_used(int degree) {
  return (degree + 1) * (degree + 1) - 1;
}

/// Basis functions beyond the constant one, `b[0 .. (degree+1)^2 - 1)`, for a unit direction.
template <typename T>
APVI_HD inline void sh_basis(int degree, T x, T y, T z, T* b) {
  if (degree < 1) return;
  b[0] = T(-kSh1) * y;
  b[1] = T(kSh1) * z;
  b[2] = T(-kSh1) * x;
  if (degree < 2) return;
  const T xx = x * x;
  const T yy = y * y;
  const T zz = z * z;
  b[3] = T(kSh2a) * x * y;
  b[4] = T(-kSh2a) * y * z;
  b[5] = T(kSh2b) * (zz + zz - xx - yy);
  b[6] = T(-kSh2a) * x * z;
  b[7] = T(kSh2c) * (xx - yy);
  if (degree < 3) return;
  const T ring = T(4) * zz - xx - yy;
  b[8] = T(-kSh3a) * y * (T(3) * xx - yy);
  b[9] = T(kSh3b) * x * y * z;
  b[10] = T(-kSh3c) * y * ring;
  b[11] = T(kSh3d) * z * (T(2) * zz - T(3) * (xx + yy));
  b[12] = T(-kSh3c) * x * ring;
  b[13] = T(kSh3e) * z * (xx - yy);
  b[14] = T(-kSh3a) * x * (xx - T(3) * yy);
}

/// Degrees 2 and 3 of `sh_basis_backward`.
template <typename T>
APVI_HD inline void sh_basis_backward_high(int degree, T x, T y, T z, const T* g, T* grad) {
  const T xy = x * y;
  const T xz = x * z;
  const T yz = y * z;
  const T a3 = T(kSh2a) * g[3];
  const T a4 = T(-kSh2a) * g[4];
  const T a5 = T(2 * kSh2b) * g[5];
  const T a6 = T(-kSh2a) * g[6];
  const T a7 = T(2 * kSh2c) * g[7];
  grad[0] = grad[0] + a3 * y - a5 * x + a6 * z + a7 * x;
  grad[1] = grad[1] + a3 * x + a4 * z - a5 * y - a7 * y;
  grad[2] = grad[2] + a4 * y + (a5 + a5) * z + a6 * x;
  if (degree < 3) return;
  const T xx = x * x;
  const T yy = y * y;
  const T zz = z * z;
  const T c8 = T(-3 * kSh3a) * g[8];
  const T c9 = T(kSh3b) * g[9];
  const T c10 = T(-kSh3c) * g[10];
  const T c11 = T(3 * kSh3d) * g[11];
  const T c12 = T(-kSh3c) * g[12];
  const T c13 = T(kSh3e) * g[13];
  const T c14 = T(-3 * kSh3a) * g[14];
  const T mixed = T(-2) * xy;
  grad[0] = grad[0] - c8 * mixed + c9 * yz + c10 * mixed - (c11 + c11) * xz +
            c12 * (T(4) * zz - T(3) * xx - yy) + (c13 + c13) * xz + c14 * (xx - yy);
  grad[1] = grad[1] + c8 * (xx - yy) + c9 * xz + c10 * (T(4) * zz - xx - T(3) * yy) -
            (c11 + c11) * yz + c12 * mixed - (c13 + c13) * yz + c14 * mixed;
  grad[2] = grad[2] + c9 * xy + T(8) * (c10 * yz + c12 * xz) + c11 * (zz + zz - xx - yy) +
            c13 * (xx - yy);
}

/// Derivative of sum(g * basis) with respect to an unconstrained direction, into `grad[3]`; the
/// caller projects it onto the tangent of the sphere.
template <typename T>
APVI_HD inline void sh_basis_backward(int degree, T x, T y, T z, const T* g, T* grad) {
  grad[0] = grad[1] = grad[2] = T(0);
  if (degree < 1) return;
  grad[0] = T(-kSh1) * g[2];
  grad[1] = T(-kSh1) * g[0];
  grad[2] = T(kSh1) * g[1];
  if (degree > 1) sh_basis_backward_high(degree, x, y, z, g, grad);
}

}  // namespace apvi::gaussians
