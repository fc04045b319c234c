// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cmath>
#include <utility>

/// A vector of W scalars without SIMD instructions: for double, and for float without AVX2. The
/// other simd_*.hpp have the same interface.
namespace apvi::gaussians::simd {

template <int W>
struct PackMask {
  bool m[W];

  friend PackMask operator&(PackMask a, PackMask b) {
    for (int i = 0; i < W; ++i) a.m[i] = a.m[i] && b.m[i];
    return a;
  }
  friend PackMask operator|(PackMask a, PackMask b) {
    for (int i = 0; i < W; ++i) a.m[i] = a.m[i] || b.m[i];
    return a;
  }
};

/// One bit per lane, lane 0 lowest.
template <int W>
unsigned bits(PackMask<W> mask) {
  unsigned out = 0;
  for (int i = 0; i < W; ++i) out |= static_cast<unsigned>(mask.m[i]) << static_cast<unsigned>(i);
  return out;
}
template <int W>
bool any(PackMask<W> mask) {
  return bits(mask) != 0;
}
/// a and not b.
template <int W>
PackMask<W> and_not(PackMask<W> a, PackMask<W> b) {
  for (int i = 0; i < W; ++i) a.m[i] = a.m[i] && !b.m[i];
  return a;
}

template <typename T, int W>
struct Pack {
  using Scalar = T;
  using Mask = PackMask<W>;
  static constexpr int kWidth = W;
  T v[W];

  Pack() = default;
  explicit Pack(double s) {
    for (T& x : v) x = static_cast<T>(s);
  }
  template <typename F>
  static Pack from(F&& f) {
    Pack out(0);
    for (int i = 0; i < W; ++i) out.v[i] = f(i);
    return out;
  }
  static Pack load(const T* p) {
    return from([p](int i) { return p[i]; });
  }
  void store(T* p) const {
    for (int i = 0; i < W; ++i) p[i] = v[i];
  }
  /// The first n lanes; the others are 0 and not accessed in memory. No alignment required.
  static Pack load_partial(const T* p, int n) {
    return from([p, n](int i) { return i < n ? p[i] : T(0); });
  }
  void store_partial(T* p, int n) const {
    for (int i = 0; i < n; ++i) p[i] = v[i];
  }
  /// The inverse of `bits`.
  static Mask mask_of(unsigned bits) {
    Mask out;
    for (int i = 0; i < W; ++i) out.m[i] = (bits >> static_cast<unsigned>(i) & 1U) != 0;
    return out;
  }
  /// 0, 1, 2, ...
  static Pack ramp() {
    return from([](int i) { return static_cast<T>(i); });
  }
  /// 0, 1, ... n - 1 repeated; and 0 n times, 1 n times, ...
  static Pack ramp_across(int n) {
    return from([n](int i) { return static_cast<T>(i % n); });
  }
  static Pack ramp_down(int n) {
    return from([n](int i) {
      const int times = i / n;
      return static_cast<T>(times);
    });
  }

  friend Pack operator+(Pack a, Pack b) {
    return from([&](int i) { return a.v[i] + b.v[i]; });
  }
  friend Pack operator-(Pack a, Pack b) {
    return from([&](int i) { return a.v[i] - b.v[i]; });
  }
  friend Pack operator*(Pack a, Pack b) {
    return from([&](int i) { return a.v[i] * b.v[i]; });
  }
  friend Pack operator/(Pack a, Pack b) {
    return from([&](int i) { return a.v[i] / b.v[i]; });
  }
  friend Mask operator>=(Pack a, Pack b) { return b <= a; }
  friend Mask operator>(Pack a, Pack b) { return b < a; }
  friend Mask operator<=(Pack a, Pack b) {
    Mask out;
    for (int i = 0; i < W; ++i) out.m[i] = a.v[i] <= b.v[i];
    return out;
  }
  friend Mask operator<(Pack a, Pack b) {
    Mask out;
    for (int i = 0; i < W; ++i) out.m[i] = a.v[i] < b.v[i];
    return out;
  }
  /// a b + c
  friend Pack fma(Pack a, Pack b, Pack c) { return a * b + c; }
  friend Pack sqrt(Pack a) {
    return from([&](int i) { return std::sqrt(a.v[i]); });
  }
  friend Pack exp2(Pack a) {
    return from([&](int i) { return std::exp2(a.v[i]); });
  }
  friend Pack log2(Pack a) {
    return from([&](int i) { return std::log2(a.v[i]); });
  }
  friend Pack floor(Pack a) {
    return from([&](int i) { return std::floor(a.v[i]); });
  }
  /// 1 / a
  friend Pack reciprocal(Pack a) {
    return from([&](int i) { return 1 / a.v[i]; });
  }
  /// -|a|
  friend Pack negative_abs(Pack a) {
    return Pack::from([&](int i) { return -std::abs(a.v[i]); });
  }
  /// Minimum and maximum; `b` when one is NaN.
  friend Pack clamp_max(Pack a, Pack b) {
    return from([&](int i) { return a.v[i] < b.v[i] ? a.v[i] : b.v[i]; });
  }
  friend Pack clamp_min(Pack a, Pack b) {
    return from([&](int i) { return a.v[i] > b.v[i] ? a.v[i] : b.v[i]; });
  }
  /// `a` where the mask is set, else `b`.
  friend Pack select(Mask mask, Pack a, Pack b) {
    return from([&](int i) { return mask.m[i] ? a.v[i] : b.v[i]; });
  }
  /// `a` where the mask is set, else 0.
  friend Pack select_or_zero(Mask mask, Pack a) { return select(mask, a, Pack(0)); }
  friend Pack where_between(Pack x, Pack low, Pack high, Pack value) {
    return select_or_zero((low <= x) & (x <= high), value);
  }
  friend T reduce_max(Pack a) {
    T out = a.v[0];
    for (const T x : a.v) out = x > out ? x : out;
    return out;
  }
  /// Transposes W rows into W columns.
  static void transpose(Pack* rows) {
    for (int i = 0; i < W; ++i) {
      for (int j = 0; j < i; ++j) std::swap(rows[i].v[j], rows[j].v[i]);
    }
  }
  /// Sums of the lanes of twelve vectors.
  static void sums(const Pack* a, T* out) {
    for (int n = 0; n < 12; ++n) {
      out[n] = 0;
      for (const T x : a[n].v) out[n] += x;
    }
  }
};

}  // namespace apvi::gaussians::simd
