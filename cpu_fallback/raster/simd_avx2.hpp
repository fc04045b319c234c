// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <immintrin.h>

#include "cpu_fallback/raster/simd_float.hpp"

/// Eight floats in AVX2 with FMA, for the rasterizer's inner loops; see simd_generic.hpp for the
/// semantics. Include only in the file compiled for such a processor.
namespace apvi::gaussians::simd {

struct Mask8 {
  __m256 m;  // a lane's bits all 1 or all 0

  friend Mask8 operator&(Mask8 a, Mask8 b) { return {_mm256_and_ps(a.m, b.m)}; }
  friend Mask8 operator|(Mask8 a, Mask8 b) { return {_mm256_or_ps(a.m, b.m)}; }
};
inline unsigned bits(Mask8 mask) {
  return static_cast<unsigned>(_mm256_movemask_ps(mask.m));
}
inline bool any(Mask8 mask) {
  return _mm256_movemask_ps(mask.m) != 0;
}
inline Mask8 and_not(Mask8 a, Mask8 b) {
  return {_mm256_andnot_ps(b.m, a.m)};
}

struct Float8 {
  using Scalar = float;
  using Mask = Mask8;
  static constexpr int kWidth = 8;
  __m256 v;

  Float8() = default;
  explicit Float8(double s) : v(_mm256_set1_ps(static_cast<float>(s))) {}
  explicit Float8(float s) : v(_mm256_set1_ps(s)) {}
  explicit Float8(int s) : v(_mm256_set1_ps(static_cast<float>(s))) {}
  explicit Float8(__m256 x) : v(x) {}

  static Float8 load(const float* p) { return Float8(_mm256_load_ps(p)); }
  void store(float* p) const { _mm256_store_ps(p, v); }
  static Float8 load_partial(const float* p, int n) {
    if (n == kWidth) return Float8(_mm256_loadu_ps(p));
    const __m256i wanted =
        _mm256_cmpgt_epi32(_mm256_set1_epi32(n), _mm256_setr_epi32(0, 1, 2, 3, 4, 5, 6, 7));
    return Float8(_mm256_maskload_ps(p, wanted));
  }
  void store_partial(float* p, int n) const {
    if (n == kWidth) return _mm256_storeu_ps(p, v);
    alignas(32) float lanes[kWidth];  // masked stores are slow without AVX-512
    store(lanes);
    for (int i = 0; i < n; ++i) p[i] = lanes[i];
  }
  static Mask mask_of(unsigned bits) {
    const __m256i powers = _mm256_setr_epi32(1, 2, 4, 8, 16, 32, 64, 128);
    const __m256i set = _mm256_and_si256(_mm256_set1_epi32(static_cast<int>(bits)), powers);
    return {_mm256_castsi256_ps(_mm256_cmpeq_epi32(set, powers))};
  }
  static Float8 ramp() { return Float8(_mm256_setr_ps(0, 1, 2, 3, 4, 5, 6, 7)); }
  static Float8 ramp_across(int) { return Float8(_mm256_setr_ps(0, 1, 2, 3, 0, 1, 2, 3)); }
  static Float8 ramp_down(int) { return Float8(_mm256_setr_ps(0, 0, 0, 0, 1, 1, 1, 1)); }

  friend Float8 operator+(Float8 a, Float8 b) { return Float8(_mm256_add_ps(a.v, b.v)); }
  friend Float8 operator-(Float8 a, Float8 b) { return Float8(_mm256_sub_ps(a.v, b.v)); }
  friend Float8 operator*(Float8 a, Float8 b) { return Float8(_mm256_mul_ps(a.v, b.v)); }
  friend Float8 operator/(Float8 a, Float8 b) { return Float8(_mm256_div_ps(a.v, b.v)); }
  friend Mask operator>=(Float8 a, Float8 b) { return {_mm256_cmp_ps(a.v, b.v, _CMP_GE_OQ)}; }
  friend Mask operator>(Float8 a, Float8 b) { return {_mm256_cmp_ps(a.v, b.v, _CMP_GT_OQ)}; }
  friend Mask operator<=(Float8 a, Float8 b) { return {_mm256_cmp_ps(a.v, b.v, _CMP_LE_OQ)}; }
  friend Mask operator<(Float8 a, Float8 b) { return {_mm256_cmp_ps(a.v, b.v, _CMP_LT_OQ)}; }
  friend Float8 fma(Float8 a, Float8 b, Float8 c) { return Float8(_mm256_fmadd_ps(a.v, b.v, c.v)); }
  friend Float8 sqrt(Float8 a) { return Float8(_mm256_sqrt_ps(a.v)); }
  friend Float8 floor(Float8 a) { return Float8(_mm256_floor_ps(a.v)); }
  friend Float8 exp2(Float8 a) {
    const __m256 x = _mm256_max_ps(_mm256_set1_ps(-126.0F), a.v);
    const __m256 whole = _mm256_round_ps(x, _MM_FROUND_TO_NEAREST_INT | _MM_FROUND_NO_EXC);
    const Float8 y = exp2_fraction(Float8(_mm256_sub_ps(x, whole)));
    const __m256i shift = _mm256_slli_epi32(_mm256_cvtps_epi32(whole), kMantissaBits);
    return Float8(_mm256_castsi256_ps(_mm256_add_epi32(_mm256_castps_si256(y.v), shift)));
  }
  friend Float8 log2(Float8 a) {
    const __m256i b = _mm256_castps_si256(a.v);
    const __m256i whole =
        _mm256_srai_epi32(_mm256_sub_epi32(b, _mm256_set1_epi32(kThreeQuarters)), kMantissaBits);
    const __m256i mantissa = _mm256_sub_epi32(b, _mm256_slli_epi32(whole, kMantissaBits));
    const Float8 t = Float8(_mm256_castsi256_ps(mantissa)) - Float8(1.0F);
    return log2_fraction(t) + Float8(_mm256_cvtepi32_ps(whole));
  }
  friend Float8 reciprocal(Float8 a) {  // 12 bits and one Newton step
    const Float8 guess(_mm256_rcp_ps(a.v));
    return Float8(_mm256_mul_ps(guess.v, _mm256_fnmadd_ps(a.v, guess.v, _mm256_set1_ps(2.0F))));
  }
  friend Float8 negative_abs(Float8 a) { return Float8(_mm256_or_ps(a.v, _mm256_set1_ps(-0.0F))); }
  friend Float8 clamp_max(Float8 a, Float8 b) { return Float8(_mm256_min_ps(a.v, b.v)); }
  friend Float8 clamp_min(Float8 a, Float8 b) { return Float8(_mm256_max_ps(a.v, b.v)); }
  friend Float8 select(Mask mask, Float8 a, Float8 b) {
    return Float8(_mm256_blendv_ps(b.v, a.v, mask.m));
  }
  friend Float8 select_or_zero(Mask mask, Float8 a) { return Float8(_mm256_and_ps(mask.m, a.v)); }
  friend Float8 where_between(Float8 x, Float8 low, Float8 high, Float8 value) {
    return select_or_zero((low <= x) & (x <= high), value);
  }
  friend float reduce_max(Float8 a) {
    const __m128 four = _mm_max_ps(_mm256_castps256_ps128(a.v), _mm256_extractf128_ps(a.v, 1));
    const __m128 two = _mm_max_ps(four, _mm_movehl_ps(four, four));
    return _mm_cvtss_f32(_mm_max_ss(two, _mm_movehdup_ps(two)));
  }
  /// Transposes eight rows into eight columns.
  static void transpose(Float8* r) {
    Float8 t[8];
    for (int i = 0; i < 8; i += 2) {
      t[i].v = _mm256_unpacklo_ps(r[i].v, r[i + 1].v);
      t[i + 1].v = _mm256_unpackhi_ps(r[i].v, r[i + 1].v);
    }
    for (int i = 0; i < 8; i += 4) {  // each half then holds four of a column
      r[i].v = _mm256_shuffle_ps(t[i].v, t[i + 2].v, 0x44);
      r[i + 1].v = _mm256_shuffle_ps(t[i].v, t[i + 2].v, 0xEE);
      r[i + 2].v = _mm256_shuffle_ps(t[i + 1].v, t[i + 3].v, 0x44);
      r[i + 3].v = _mm256_shuffle_ps(t[i + 1].v, t[i + 3].v, 0xEE);
    }
    for (int i = 0; i < 4; ++i) {
      const __m256 top = r[i].v;
      const __m256 bottom = r[4 + i].v;
      r[i].v = _mm256_permute2f128_ps(top, bottom, 0x20);
      r[4 + i].v = _mm256_permute2f128_ps(top, bottom, 0x31);
    }
  }
  /// Sums of the lanes of twelve vectors.
  static void sums(const Float8* a, float* out) {
    for (int n = 0; n < 12; n += 4) {
      const __m256 x = _mm256_hadd_ps(_mm256_hadd_ps(a[n].v, a[n + 1].v),
                                      _mm256_hadd_ps(a[n + 2].v, a[n + 3].v));
      _mm_storeu_ps(out + n, _mm_add_ps(_mm256_castps256_ps128(x), _mm256_extractf128_ps(x, 1)));
    }
  }
};

}  // namespace apvi::gaussians::simd
