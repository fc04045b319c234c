// SPDX-License-Identifier: BSD-3-Clause
#include "sim/world/noise_texture.hpp"

#include <algorithm>
#include <cmath>

#include "sim/world/clones.hpp"

namespace apvi::sim {
namespace {

constexpr float kLacunarity = 2.03F;  // not 2, so that the lattices of octaves do not align
// Variance of an octave of amplitude 1, and of its slope along an axis at a frequency of 1 / m.
constexpr float kValueVariance = 0.0364F;
constexpr float kSlopeVariance = 0.248F;

#define APVI_INLINE inline __attribute__((always_inline))

struct Noise {
  float value, dx, dy, dz;
};

// std::floor is a function call without -ffast-math; the cast rounds toward zero, hence the
// correction.
APVI_INLINE int floor_int(float x) {
  const int i = static_cast<int>(x);
  return i - static_cast<int>(x < static_cast<float>(i));
}

APVI_INLINE std::uint32_t lattice_hash(std::uint32_t x, std::uint32_t y, std::uint32_t z,
                                       std::uint32_t seed) {
  std::uint32_t h = (x * 0x8da6b343U) ^ (y * 0xd8163841U) ^ (z * 0xcb1ab31fU) ^ seed;
  h ^= h >> 15;
  h *= 0x846ca68bU;
  h ^= h >> 13;
  h *= 0x7feb352dU;
  return h ^ (h >> 16);
}

// Ten bits of the hash as a number in [-1, 1).
APVI_INLINE float component(std::uint32_t h, int shift) {
  return static_cast<float>(static_cast<int>((h >> shift) & 1023U) - 512) * (1.0F / 512.0F);
}

struct Corner {
  float gx, gy, gz, dot;
};

APVI_INLINE Corner corner(std::uint32_t x, std::uint32_t y, std::uint32_t z, std::uint32_t seed,
                          float fx, float fy, float fz) {
  const std::uint32_t h = lattice_hash(x, y, z, seed);
  const float gx = component(h, 0);
  const float gy = component(h, 10);
  const float gz = component(h, 20);
  return {gx, gy, gz, gx * fx + gy * fy + gz * fz};
}

APVI_INLINE float lerp8(float a, float b, float c, float d, float e, float f, float g, float h,
                        float u, float v, float w) {
  const float x00 = a + (b - a) * u;
  const float x10 = c + (d - c) * u;
  const float x01 = e + (f - e) * u;
  const float x11 = g + (h - g) * u;
  const float y0 = x00 + (x10 - x00) * v;
  const float y1 = x01 + (x11 - x01) * v;
  return y0 + (y1 - y0) * w;
}

// Gradient noise with its derivative (Quilez, "Gradient noise derivatives").
APVI_INLINE Noise gradient_noise(float px, float py, float pz, std::uint32_t seed) {
  const int ix = floor_int(px);
  const int iy = floor_int(py);
  const int iz = floor_int(pz);
  const float x = px - static_cast<float>(ix);
  const float y = py - static_cast<float>(iy);
  const float z = pz - static_cast<float>(iz);
  const auto X = static_cast<std::uint32_t>(ix);
  const auto Y = static_cast<std::uint32_t>(iy);
  const auto Z = static_cast<std::uint32_t>(iz);
  const Corner a = corner(X, Y, Z, seed, x, y, z);
  const Corner b = corner(X + 1, Y, Z, seed, x - 1, y, z);
  const Corner c = corner(X, Y + 1, Z, seed, x, y - 1, z);
  const Corner d = corner(X + 1, Y + 1, Z, seed, x - 1, y - 1, z);
  const Corner e = corner(X, Y, Z + 1, seed, x, y, z - 1);
  const Corner f = corner(X + 1, Y, Z + 1, seed, x - 1, y, z - 1);
  const Corner g = corner(X, Y + 1, Z + 1, seed, x, y - 1, z - 1);
  const Corner h = corner(X + 1, Y + 1, Z + 1, seed, x - 1, y - 1, z - 1);
  const float u = x * x * x * (x * (x * 6 - 15) + 10);
  const float v = y * y * y * (y * (y * 6 - 15) + 10);
  const float w = z * z * z * (z * (z * 6 - 15) + 10);
  const float du = 30 * x * x * (x * (x - 2) + 1);
  const float dv = 30 * y * y * (y * (y - 2) + 1);
  const float dw = 30 * z * z * (z * (z - 2) + 1);
  const float k1 = b.dot - a.dot;
  const float k2 = c.dot - a.dot;
  const float k3 = e.dot - a.dot;
  const float k4 = a.dot - b.dot - c.dot + d.dot;
  const float k5 = a.dot - c.dot - e.dot + g.dot;
  const float k6 = a.dot - b.dot - e.dot + f.dot;
  const float k7 = -a.dot + b.dot + c.dot - d.dot + e.dot - f.dot - g.dot + h.dot;
  // NOLINTNEXTLINE(cppcoreguidelines-pro-type-member-init): scratch, filled before use
  Noise n;
  n.value =
      a.dot + k1 * u + k2 * v + k3 * w + k4 * u * v + k5 * v * w + k6 * w * u + k7 * u * v * w;
  n.dx = lerp8(a.gx, b.gx, c.gx, d.gx, e.gx, f.gx, g.gx, h.gx, u, v, w) +
         du * (k1 + k4 * v + k6 * w + k7 * v * w);
  n.dy = lerp8(a.gy, b.gy, c.gy, d.gy, e.gy, f.gy, g.gy, h.gy, u, v, w) +
         dv * (k2 + k5 * w + k4 * u + k7 * w * u);
  n.dz = lerp8(a.gz, b.gz, c.gz, d.gz, e.gz, f.gz, g.gz, h.gz, u, v, w) +
         dw * (k3 + k6 * u + k5 * v + k7 * u * v);
  return n;
}

APVI_CLONES void add_octave(const Points& p, const std::array<float, 3>& scale, float frequency,
                            float amplitude, std::uint32_t seed, Lanes& out) {
  for (int i = 0; i < kBatch; ++i) {
    const Noise n =
        gradient_noise(p.x.v[i] * scale[0], p.y.v[i] * scale[1], p.z.v[i] * scale[2], seed);
    out.v[i] += n.value * amplitude * octave_weight(p.footprint.v[i], frequency);
  }
}

APVI_CLONES void add_octave_gradient(const Points& p, const std::array<float, 3>& scale,
                                     float frequency, float amplitude, std::uint32_t seed,
                                     Gradient& out) {
  for (int i = 0; i < kBatch; ++i) {
    const Noise n =
        gradient_noise(p.x.v[i] * scale[0], p.y.v[i] * scale[1], p.z.v[i] * scale[2], seed);
    const float a = amplitude * octave_weight(p.footprint.v[i], frequency);
    out.value.v[i] += n.value * a;
    out.dx.v[i] += n.dx * a * scale[0];
    out.dy.v[i] += n.dy * a * scale[1];
    out.dz.v[i] += n.dz * a * scale[2];
  }
}

// Adds the variance of the filtered-out part of an octave; `of_one` is that of amplitude 1.
APVI_CLONES void add_lost_variance(const Points& p, float frequency, float amplitude, float of_one,
                                   Lanes& out) {
  for (int i = 0; i < kBatch; ++i) {
    const float seen = octave_weight(p.footprint.v[i], frequency);
    out.v[i] += (1.0F - seen * seen) * amplitude * amplitude * of_one;
  }
}

float smallest_footprint(const Points& p) {
  return *std::min_element(p.footprint.v, p.footprint.v + std::max(1, p.count));
}

// Calls `octave(frequency, highest frequency along an axis, amplitude, index)` for all octaves.
template <typename Octave>
void for_each_octave(const Fbm& spec, Octave&& octave) {
  const float widest = std::max({spec.stretch[0], spec.stretch[1], spec.stretch[2]});
  float frequency = spec.frequency;
  float amplitude = 1.0F;
  for (int k = 0; k < spec.octaves; ++k) {
    octave(frequency, frequency * widest, amplitude, k);
    frequency *= kLacunarity;
    amplitude *= spec.gain;
  }
}

// Calls `octave(scale, frequency, amplitude, seed)` for the octaves not filtered out everywhere.
template <typename Octave>
void for_each_visible_octave(const Fbm& spec, float footprint, Octave&& octave) {
  for_each_octave(spec, [&](float frequency, float highest, float amplitude, int k) {
    if (footprint * highest > 0.6F) return;
    const std::array<float, 3> scale{frequency * spec.stretch[0], frequency * spec.stretch[1],
                                     frequency * spec.stretch[2]};
    octave(scale, highest, amplitude, hash32(spec.seed, static_cast<std::uint32_t>(k)));
  });
}

APVI_INLINE void nearest_in_cell(std::uint32_t X, std::uint32_t Y, std::uint32_t Z, int ox, int oy,
                                 int oz, float x, float y, float z, std::uint32_t seed,
                                 float& first, float& second, float& bx, float& by, float& bz,
                                 std::uint32_t& best) {
  const std::uint32_t h =
      lattice_hash(X + static_cast<std::uint32_t>(ox), Y + static_cast<std::uint32_t>(oy),
                   Z + static_cast<std::uint32_t>(oz), seed);
  const float dx = x - static_cast<float>(ox) - 0.5F - 0.42F * component(h, 0);
  const float dy = y - static_cast<float>(oy) - 0.5F - 0.42F * component(h, 10);
  const float dz = z - static_cast<float>(oz) - 0.5F - 0.42F * component(h, 20);
  const float d = dx * dx + dy * dy + dz * dz;
  const bool nearer = d < first;
  const float loser = nearer ? first : d;
  second = loser < second ? loser : second;
  first = nearer ? d : first;
  bx = nearer ? dx : bx;
  by = nearer ? dy : by;
  bz = nearer ? dz : bz;
  best = nearer ? h : best;
}

struct NearestPoints {
  Lanes first, second;
  std::uint32_t hash[kBatch];
};

APVI_CLONES void visit_neighbor(const Points& p, float frequency, std::uint32_t seed, int ox,
                                int oy, int oz, NearestPoints& best, Cells& out) {
  for (int i = 0; i < kBatch; ++i) {
    const float px = p.x.v[i] * frequency;
    const float py = p.y.v[i] * frequency;
    const float pz = p.z.v[i] * frequency;
    const int ix = floor_int(px);
    const int iy = floor_int(py);
    const int iz = floor_int(pz);
    nearest_in_cell(static_cast<std::uint32_t>(ix), static_cast<std::uint32_t>(iy),
                    static_cast<std::uint32_t>(iz), ox, oy, oz, px - static_cast<float>(ix),
                    py - static_cast<float>(iy), pz - static_cast<float>(iz), seed, best.first.v[i],
                    best.second.v[i], out.dx.v[i], out.dy.v[i], out.dz.v[i], best.hash[i]);
  }
}

APVI_CLONES void finish_cells(const Points& p, float frequency, const NearestPoints& best,
                              Cells& out) {
  for (int i = 0; i < kBatch; ++i) {
    out.nearest.v[i] = __builtin_sqrtf(best.first.v[i]);
    out.border.v[i] = __builtin_sqrtf(best.second.v[i]) - out.nearest.v[i];
    out.id.v[i] =
        static_cast<float>(static_cast<int>((best.hash[i] * 0x9e3779b1U) >> 8)) * 0x1.0p-24F;
    out.weight.v[i] = octave_weight(p.footprint.v[i], frequency);
  }
}

}  // namespace

void fbm(const Points& p, const Fbm& spec, Lanes& out) {
  out.fill(0.0F);
  for_each_visible_octave(
      spec, smallest_footprint(p),
      [&](const auto& scale, float frequency, float amplitude, std::uint32_t seed) {
        add_octave(p, scale, frequency, amplitude, seed, out);
      });
}

void fbm(const Points& p, const Fbm& spec, Lanes& out, Lanes& lost_variance) {
  fbm(p, spec, out);
  lost_variance.fill(0.0F);
  for_each_octave(spec, [&](float, float highest, float amplitude, int) {
    add_lost_variance(p, highest, amplitude, kValueVariance, lost_variance);
  });
}

float fbm(const Eigen::Vector3f& p, const Fbm& spec) {
  float sum = 0.0F;
  for_each_visible_octave(
      spec, 0.0F, [&](const auto& scale, float, float amplitude, std::uint32_t seed) {
        sum += amplitude *
               gradient_noise(p.x() * scale[0], p.y() * scale[1], p.z() * scale[2], seed).value;
      });
  return sum;
}

void fbm_gradient(const Points& p, const Fbm& spec, Gradient& out) {
  for (Lanes* lanes : {&out.value, &out.dx, &out.dy, &out.dz}) lanes->fill(0.0F);
  for_each_visible_octave(
      spec, smallest_footprint(p),
      [&](const auto& scale, float frequency, float amplitude, std::uint32_t seed) {
        add_octave_gradient(p, scale, frequency, amplitude, seed, out);
      });
  out.lost_variance.fill(0.0F);
  for_each_octave(spec, [&](float frequency, float highest, float amplitude, int) {
    add_lost_variance(p, highest, frequency * amplitude, kSlopeVariance, out.lost_variance);
  });
}

void cells(const Points& p, float frequency, std::uint32_t seed, Cells& out) {
  if (smallest_footprint(p) * frequency > 0.6F) {  // filtered out everywhere: skip the 27 cells
    for (Lanes* lanes : {&out.border, &out.id, &out.dx, &out.dy, &out.dz, &out.weight}) {
      lanes->fill(0.0F);
    }
    out.nearest.fill(0.5F);
    return;
  }
  // NOLINTNEXTLINE(cppcoreguidelines-pro-type-member-init): scratch, filled before use
  NearestPoints best;
  best.first.fill(1e9F);
  best.second.fill(1e9F);
  std::fill(best.hash, best.hash + kBatch, 0U);
  for (int oz = -1; oz <= 1; ++oz) {
    for (int oy = -1; oy <= 1; ++oy) {
      for (int ox = -1; ox <= 1; ++ox) {
        visit_neighbor(p, frequency, seed, ox, oy, oz, best, out);
      }
    }
  }
  finish_cells(p, frequency, best, out);
}

}  // namespace apvi::sim
