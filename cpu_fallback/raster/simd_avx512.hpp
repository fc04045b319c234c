// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <immintrin.h>

#include "cpu_fallback/raster/simd_float.hpp"

/// Sixteen floats in AVX-512, for the rasterizer's inner loops; see simd_generic.hpp for the
/// semantics. Include only in the file compiled for such a processor.
namespace apvi::gaussians::simd {

struct Mask16 {
  __mmask16 m;

  friend Mask16 operator&(Mask16 a, Mask16 b) { return {_kand_mask16(a.m, b.m)}; }
  friend Mask16 operator|(Mask16 a, Mask16 b) { return {_kor_mask16(a.m, b.m)}; }
};
inline unsigned bits(Mask16 mask) {
  return mask.m;
}
inline bool any(Mask16 mask) {
  return mask.m != 0;
}
inline Mask16 and_not(Mask16 a, Mask16 b) {
  return {_kandn_mask16(b.m, a.m)};
}

struct Float16 {
  using Scalar = float;
  using Mask = Mask16;
  static constexpr int kWidth = 16;
  __m512 v;

  Float16() = default;
  explicit Float16(double s) : v(_mm512_set1_ps(static_cast<float>(s))) {}
  explicit Float16(float s) : v(_mm512_set1_ps(s)) {}
  explicit Float16(int s) : v(_mm512_set1_ps(static_cast<float>(s))) {}
  explicit Float16(__m512 x) : v(x) {}

  static Float16 load(const float* p) { return Float16(_mm512_load_ps(p)); }
  void store(float* p) const { _mm512_store_ps(p, v); }
  static Float16 load_partial(const float* p, int n) {
    return Float16(_mm512_maskz_loadu_ps(first_lanes(n), p));
  }
  void store_partial(float* p, int n) const { _mm512_mask_storeu_ps(p, first_lanes(n), v); }
  static __mmask16 first_lanes(int n) {
    return static_cast<__mmask16>((1U << static_cast<unsigned>(n)) - 1U);
  }
  static Mask mask_of(unsigned bits) { return {static_cast<__mmask16>(bits)}; }
  static Float16 ramp() {
    return Float16(_mm512_setr_ps(0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15));
  }
  static Float16 ramp_across(int) {
    return Float16(_mm512_setr_ps(0, 1, 2, 3, 0, 1, 2, 3, 0, 1, 2, 3, 0, 1, 2, 3));
  }
  static Float16 ramp_down(int) {
    return Float16(_mm512_setr_ps(0, 0, 0, 0, 1, 1, 1, 1, 2, 2, 2, 2, 3, 3, 3, 3));
  }

  friend Float16 operator+(Float16 a, Float16 b) { return Float16(_mm512_add_ps(a.v, b.v)); }
  friend Float16 operator-(Float16 a, Float16 b) { return Float16(_mm512_sub_ps(a.v, b.v)); }
  friend Float16 operator*(Float16 a, Float16 b) { return Float16(_mm512_mul_ps(a.v, b.v)); }
  friend Float16 operator/(Float16 a, Float16 b) { return Float16(_mm512_div_ps(a.v, b.v)); }
  friend Mask operator>=(Float16 a, Float16 b) {
    return {_mm512_cmp_ps_mask(a.v, b.v, _CMP_GE_OQ)};
  }
  friend Mask operator>(Float16 a, Float16 b) { return {_mm512_cmp_ps_mask(a.v, b.v, _CMP_GT_OQ)}; }
  friend Mask operator<=(Float16 a, Float16 b) {
    return {_mm512_cmp_ps_mask(a.v, b.v, _CMP_LE_OQ)};
  }
  friend Mask operator<(Float16 a, Float16 b) { return {_mm512_cmp_ps_mask(a.v, b.v, _CMP_LT_OQ)}; }
  friend Float16 fma(Float16 a, Float16 b, Float16 c) {
    return Float16(_mm512_fmadd_ps(a.v, b.v, c.v));
  }
  friend Float16 sqrt(Float16 a) { return Float16(_mm512_sqrt_ps(a.v)); }
  friend Float16 floor(Float16 a) {
    return Float16(_mm512_roundscale_ps(a.v, _MM_FROUND_TO_NEG_INF | _MM_FROUND_NO_EXC));
  }
  friend Float16 exp2(Float16 a) {
    const __m512 whole = _mm512_roundscale_ps(a.v, _MM_FROUND_TO_NEAREST_INT | _MM_FROUND_NO_EXC);
    const Float16 fraction(_mm512_sub_ps(a.v, whole));
    return Float16(_mm512_scalef_ps(exp2_fraction(fraction).v, whole));
  }
  friend Float16 log2(Float16 a) {
    const __m512i b = _mm512_castps_si512(a.v);
    const __m512i whole =
        _mm512_srai_epi32(_mm512_sub_epi32(b, _mm512_set1_epi32(kThreeQuarters)), kMantissaBits);
    const __m512i mantissa = _mm512_sub_epi32(b, _mm512_slli_epi32(whole, kMantissaBits));
    const Float16 t = Float16(_mm512_castsi512_ps(mantissa)) - Float16(1.0F);
    return log2_fraction(t) + Float16(_mm512_cvtepi32_ps(whole));
  }
  friend Float16 reciprocal(Float16 a) {  // 14 bits and one Newton step
    const Float16 guess(_mm512_rcp14_ps(a.v));
    return Float16(_mm512_mul_ps(guess.v, _mm512_fnmadd_ps(a.v, guess.v, _mm512_set1_ps(2.0F))));
  }
  friend Float16 negative_abs(Float16 a) {
    return Float16(_mm512_or_ps(a.v, _mm512_set1_ps(-0.0F)));
  }
  friend Float16 clamp_max(Float16 a, Float16 b) { return Float16(_mm512_min_ps(a.v, b.v)); }
  friend Float16 clamp_min(Float16 a, Float16 b) { return Float16(_mm512_max_ps(a.v, b.v)); }
  friend Float16 select(Mask mask, Float16 a, Float16 b) {
    return Float16(_mm512_mask_blend_ps(mask.m, b.v, a.v));
  }
  friend Float16 select_or_zero(Mask mask, Float16 a) {
    return Float16(_mm512_maskz_mov_ps(mask.m, a.v));
  }
  friend Float16 where_between(Float16 x, Float16 low, Float16 high, Float16 value) {
    return select_or_zero((low <= x) & (x <= high), value);
  }
  friend float reduce_max(Float16 a) { return _mm512_reduce_max_ps(a.v); }
  /// Transposes sixteen rows into sixteen columns.
  static void transpose(Float16* r) {
    Float16 t[16];
    for (int i = 0; i < 16; i += 2) {
      t[i].v = _mm512_unpacklo_ps(r[i].v, r[i + 1].v);
      t[i + 1].v = _mm512_unpackhi_ps(r[i].v, r[i + 1].v);
    }
    for (int i = 0; i < 16; i += 4) {  // each quarter then holds four of a column
      r[i].v = low_pairs(t[i].v, t[i + 2].v);
      r[i + 1].v = high_pairs(t[i].v, t[i + 2].v);
      r[i + 2].v = low_pairs(t[i + 1].v, t[i + 3].v);
      r[i + 3].v = high_pairs(t[i + 1].v, t[i + 3].v);
    }
    for (int i = 0; i < 4; ++i) {
      const __m512 even_top = _mm512_shuffle_f32x4(r[i].v, r[4 + i].v, 0x88);
      const __m512 odd_top = _mm512_shuffle_f32x4(r[i].v, r[4 + i].v, 0xDD);
      const __m512 even_bottom = _mm512_shuffle_f32x4(r[8 + i].v, r[12 + i].v, 0x88);
      const __m512 odd_bottom = _mm512_shuffle_f32x4(r[8 + i].v, r[12 + i].v, 0xDD);
      r[i].v = _mm512_shuffle_f32x4(even_top, even_bottom, 0x88);
      r[4 + i].v = _mm512_shuffle_f32x4(odd_top, odd_bottom, 0x88);
      r[8 + i].v = _mm512_shuffle_f32x4(even_top, even_bottom, 0xDD);
      r[12 + i].v = _mm512_shuffle_f32x4(odd_top, odd_bottom, 0xDD);
    }
  }
  static __m512 low_pairs(__m512 a, __m512 b) {
    return _mm512_castpd_ps(_mm512_unpacklo_pd(_mm512_castps_pd(a), _mm512_castps_pd(b)));
  }
  static __m512 high_pairs(__m512 a, __m512 b) {
    return _mm512_castpd_ps(_mm512_unpackhi_pd(_mm512_castps_pd(a), _mm512_castps_pd(b)));
  }
  /// Sums of four vectors, replicated over the four quarters of the result.
  static __m512 quarter_sums(const Float16* a) {
    const __m512 ab =
        _mm512_add_ps(_mm512_unpacklo_ps(a[0].v, a[1].v), _mm512_unpackhi_ps(a[0].v, a[1].v));
    const __m512 cd =
        _mm512_add_ps(_mm512_unpacklo_ps(a[2].v, a[3].v), _mm512_unpackhi_ps(a[2].v, a[3].v));
    return _mm512_add_ps(low_pairs(ab, cd), high_pairs(ab, cd));
  }
  /// Sums of the lanes of twelve vectors.
  static void sums(const Float16* a, float* out) {
    const __m512 p = quarter_sums(a);
    const __m512 q = quarter_sums(a + 4);
    const __m512 r = quarter_sums(a + 8);
    const __m512 pq =
        _mm512_add_ps(_mm512_shuffle_f32x4(p, q, 0x44), _mm512_shuffle_f32x4(p, q, 0xEE));
    const __m512 rr =
        _mm512_add_ps(_mm512_shuffle_f32x4(r, r, 0x44), _mm512_shuffle_f32x4(r, r, 0xEE));
    const __m512 all =
        _mm512_add_ps(_mm512_shuffle_f32x4(pq, rr, 0x88), _mm512_shuffle_f32x4(pq, rr, 0xDD));
    _mm512_mask_storeu_ps(out, 0x0FFF, all);
  }
};

}  // namespace apvi::gaussians::simd
