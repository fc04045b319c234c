// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cmath>

#include "gaussians/render/splat_math.hpp"

/// Projection of a 3D Gaussian to its image footprint (Zwicker et al., "EWA splatting", 2002) and
/// its derivatives. T is a scalar or a vector of scalars; matrices are row-major.
namespace apvi::gaussians {

/// Camera parameters of the renderer.
template <typename T>
struct Camera {
  T R[9];       ///< world to camera
  T t[3];       ///< [m]
  T center[3];  ///< camera center in the world [m]
  T fx, fy, cx, cy;
  T x_min, x_max, y_min, y_max;  ///< bounds on x/z and y/z where the projection is linearized
  T near_m;
  T low_pass;  ///< [px²]
};

/// A Gaussian's footprint, with the intermediate values that the derivatives need.
template <typename T>
struct Projection {
  T p[3];  ///< center in the camera frame [m]
  T inv_z;
  T ray_x, ray_y;  ///< x/z and y/z clamped to the camera's bounds
  T q[4];          ///< unit quaternion w x y z
  T inv_norm;      ///< inverse norm of the input quaternion
  T axes[9];       ///< columns: the Gaussian's axes in the camera frame
  T s[3];          ///< standard deviations along them [m]
  T image[6];      ///< axes in the image [px/m]: x of the three, then y
  T m[6];          ///< the same times the standard deviations [px]
  T u, v;          ///< center [px]
  T a, b, c;       ///< covariance [[a, b], [b, c]] with low-pass [px²]
  T det;           ///< its determinant
  T det_orig;      ///< determinant without the low-pass
};

/// Rotation matrix of a unit quaternion w x y z.
template <typename T>
APVI_HD inline void quaternion_to_matrix(const T* q, T* R) {
  const T x2 = q[1] + q[1];
  const T y2 = q[2] + q[2];
  const T z2 = q[3] + q[3];
  R[0] = T(1) - (y2 * q[2] + z2 * q[3]);
  R[1] = x2 * q[2] - z2 * q[0];
  R[2] = x2 * q[3] + y2 * q[0];
  R[3] = x2 * q[2] + z2 * q[0];
  R[4] = T(1) - (x2 * q[1] + z2 * q[3]);
  R[5] = y2 * q[3] - x2 * q[0];
  R[6] = x2 * q[3] - y2 * q[0];
  R[7] = y2 * q[3] + x2 * q[0];
  R[8] = T(1) - (x2 * q[1] + y2 * q[2]);
}

/// Derivative with respect to the unit quaternion, from the derivative V with respect to the
/// matrix.
template <typename T>
APVI_HD inline void quaternion_to_matrix_backward(const T* q, const T* V, T* g) {
  const T two = T(2);
  g[0] = two * (q[3] * (V[3] - V[1]) + q[2] * (V[2] - V[6]) + q[1] * (V[7] - V[5]));
  g[1] = two * (q[2] * (V[1] + V[3]) + q[3] * (V[2] + V[6]) + q[0] * (V[7] - V[5]) -
                two * q[1] * (V[4] + V[8]));
  g[2] = two * (q[1] * (V[1] + V[3]) + q[3] * (V[5] + V[7]) + q[0] * (V[2] - V[6]) -
                two * q[2] * (V[0] + V[8]));
  g[3] = two * (q[1] * (V[2] + V[6]) + q[2] * (V[5] + V[7]) + q[0] * (V[3] - V[1]) -
                two * q[3] * (V[0] + V[4]));
}

/// out = M x for a 3x3 matrix.
template <typename T>
APVI_HD inline void rotate(const T* M, const T* x, T* out) {
  for (int i = 0; i < 3; ++i, M += 3) out[i] = M[0] * x[0] + M[1] * x[1] + M[2] * x[2];
}

/// out = transpose(M) x for a 3x3 matrix.
template <typename T>
APVI_HD inline void rotate_back(const T* M, const T* x, T* out) {
  for (int i = 0; i < 3; ++i) out[i] = M[i] * x[0] + M[3 + i] * x[1] + M[6 + i] * x[2];
}

/// The Gaussian's axes in the camera frame.
template <typename T>
APVI_HD inline void rotate_axes(const Camera<T>& camera, const T* quaternion, Projection<T>& out) {
  using std::sqrt;
  T norm2 = T(0);
  for (int i = 0; i < 4; ++i) norm2 = norm2 + quaternion[i] * quaternion[i];
  out.inv_norm = T(1) / sqrt(norm2);
  for (int i = 0; i < 4; ++i) out.q[i] = quaternion[i] * out.inv_norm;
  T R[9];
  quaternion_to_matrix(out.q, R);
  for (int i = 0; i < 3; ++i) {
    for (int j = 0; j < 3; ++j) {
      out.axes[3 * i + j] =
          camera.R[3 * i] * R[j] + camera.R[3 * i + 1] * R[3 + j] + camera.R[3 * i + 2] * R[6 + j];
    }
  }
}

/// Footprint covariance J axes S (J axes S)^T + low-pass. The determinant is the sum of squared
/// minors (Cauchy-Binet), which stays accurate for needle-shaped Gaussians.
template <typename T>
APVI_HD inline void project_covariance(const Camera<T>& camera, Projection<T>& out) {
  const T jx = camera.fx * out.inv_z;
  const T jy = camera.fy * out.inv_z;
  for (int k = 0; k < 3; ++k) {
    out.image[k] = jx * (out.axes[k] - out.ray_x * out.axes[6 + k]);
    out.image[3 + k] = jy * (out.axes[3 + k] - out.ray_y * out.axes[6 + k]);
    out.m[k] = out.image[k] * out.s[k];
    out.m[3 + k] = out.image[3 + k] * out.s[k];
  }
  const T* const m = out.m;
  const T a = m[0] * m[0] + m[1] * m[1] + m[2] * m[2];
  const T c = m[3] * m[3] + m[4] * m[4] + m[5] * m[5];
  out.b = m[0] * m[3] + m[1] * m[4] + m[2] * m[5];
  const T d0 = m[1] * m[5] - m[2] * m[4];
  const T d1 = m[2] * m[3] - m[0] * m[5];
  const T d2 = m[0] * m[4] - m[1] * m[3];
  out.det_orig = d0 * d0 + d1 * d1 + d2 * d2;
  out.det = out.det_orig + camera.low_pass * (a + c + camera.low_pass);
  out.a = a + camera.low_pass;
  out.c = c + camera.low_pass;
}

/// Footprint of a Gaussian. Undefined when its center is not in front of the camera.
template <typename T>
APVI_HD inline Projection<T> project(const Camera<T>& camera, const T* mean, const T* scales,
                                     const T* quaternion) {
  Projection<T> out = {};
  rotate(camera.R, mean, out.p);
  for (int i = 0; i < 3; ++i) {
    out.p[i] = out.p[i] + camera.t[i];
    out.s[i] = scales[i];
  }
  out.inv_z = T(1) / out.p[2];
  const T x = out.p[0] * out.inv_z;
  const T y = out.p[1] * out.inv_z;
  out.ray_x = clamp_max(clamp_min(x, camera.x_min), camera.x_max);
  out.ray_y = clamp_max(clamp_min(y, camera.y_min), camera.y_max);
  out.u = camera.fx * x + camera.cx;
  out.v = camera.fy * y + camera.cy;
  rotate_axes(camera, quaternion, out);
  project_covariance(camera, out);
  return out;
}

/// Derivatives of the loss with respect to a footprint.
template <typename T>
struct FootprintGradient {
  T u, v;     ///< center
  T z;        ///< blended depth
  T a, b, c;  ///< covariance
};

/// Derivatives of the loss with respect to a Gaussian and a left perturbation of the camera pose.
template <typename T>
struct ProjectionGradient {
  T mean[3];
  T log_scale[3];
  T quaternion[4];
  T pose[6];  ///< translation, rotation
};

/// Backward pass of `project_covariance`: writes log_scale and V (derivative with respect to the
/// axes) and adds to `p` (with respect to the center).
template <typename T>
APVI_HD inline void project_covariance_backward(const Camera<T>& camera, const Projection<T>& f,
                                                const FootprintGradient<T>& g, T* log_scale, T* V,
                                                T* p) {
  const T jx = camera.fx * f.inv_z;
  const T jy = camera.fy * f.inv_z;
  T ray_x = T(0);  // derivatives by the clamped rays; zoom: by jx, jy times jx, jy
  T ray_y = T(0);
  T zoom = T(0);
  for (int k = 0; k < 3; ++k) {
    const T mx = (g.a + g.a) * f.m[k] + g.b * f.m[3 + k];
    const T my = (g.c + g.c) * f.m[3 + k] + g.b * f.m[k];
    log_scale[k] = mx * f.m[k] + my * f.m[3 + k];
    zoom = zoom + log_scale[k];
    const T tx = mx * f.s[k] * jx;
    const T ty = my * f.s[k] * jy;
    V[k] = tx;
    V[3 + k] = ty;
    V[6 + k] = T(0) - (f.ray_x * tx + f.ray_y * ty);
    ray_x = ray_x - tx * f.axes[6 + k];
    ray_y = ray_y - ty * f.axes[6 + k];
  }
  const T x = f.p[0] * f.inv_z;
  const T y = f.p[1] * f.inv_z;
  ray_x = where_between(x, camera.x_min, camera.x_max, ray_x) + g.u * camera.fx;
  ray_y = where_between(y, camera.y_min, camera.y_max, ray_y) + g.v * camera.fy;
  p[0] = ray_x * f.inv_z;
  p[1] = ray_y * f.inv_z;
  p[2] = g.z - (ray_x * x + ray_y * y + zoom) * f.inv_z;
}

/// Backward pass of `project`.
template <typename T>
APVI_HD inline ProjectionGradient<T> project_backward(const Camera<T>& camera,
                                                      const Projection<T>& f,
                                                      const FootprintGradient<T>& g) {
  ProjectionGradient<T> out = {};
  T V[9];
  T p[3];
  project_covariance_backward(camera, f, g, out.log_scale, V, p);
  rotate_back(camera.R, p, out.mean);
  for (int i = 0; i < 3; ++i) {
    const int j = (i + 1) % 3;
    const int k = (i + 2) % 3;
    T rotation = f.p[j] * p[k] - f.p[k] * p[j];
    for (int n = 0; n < 3; ++n) {
      rotation = rotation + f.axes[3 * j + n] * V[3 * k + n] - f.axes[3 * k + n] * V[3 * j + n];
    }
    out.pose[i] = p[i];
    out.pose[3 + i] = rotation;
  }
  T W[9];  // derivative by the quaternion's rotation matrix
  for (int i = 0; i < 3; ++i) {
    for (int j = 0; j < 3; ++j) {
      W[3 * i + j] = camera.R[i] * V[j] + camera.R[3 + i] * V[3 + j] + camera.R[6 + i] * V[6 + j];
    }
  }
  T q[4];
  quaternion_to_matrix_backward(f.q, W, q);
  T along = T(0);
  for (int i = 0; i < 4; ++i) along = along + q[i] * f.q[i];
  for (int i = 0; i < 4; ++i) out.quaternion[i] = (q[i] - along * f.q[i]) * f.inv_norm;
  return out;
}

}  // namespace apvi::gaussians
