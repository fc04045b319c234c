// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <vector>

#include "apvi/core/error.hpp"
#include "map_io/gzip.hpp"
#include "map_io/quantization.hpp"
#include "map_io/spz.hpp"
#include "map_io/spz_layout.hpp"

namespace apvi::map_io {
namespace {

using Bytes = std::vector<unsigned char>;

struct Header {
  std::uint32_t version = 0;
  std::uint32_t count = 0;
  std::size_t rest = 0;  // coefficients per channel in the file
  int fractional_bits = 0;
  bool antialiased = false;

  std::size_t rotation_bytes() const { return version == 2 ? 3 : 4; }
  std::size_t bytes_each() const { return 9 + 1 + 3 + 3 + rotation_bytes() + 3 * rest; }
};

std::uint32_t little_endian(const unsigned char* b) {
  return b[0] | static_cast<std::uint32_t>(b[1]) << 8U | static_cast<std::uint32_t>(b[2]) << 16U |
         static_cast<std::uint32_t>(b[3]) << 24U;
}

Header read_header(GzipReader& in, const std::string& name) {
  std::array<unsigned char, kSpzHeaderBytes> b{};
  in.read(b.data(), b.size());
  if (little_endian(b.data()) != kSpzMagic) {
    fail_input("{}: a gzip file, but not an SPZ file of Gaussians", name);
  }
  Header header{.version = little_endian(b.data() + 4), .count = little_endian(b.data() + 8)};
  if (header.version != 2 && header.version != 3) {
    fail_input("{}: version {} of SPZ; versions 2 and 3 are supported", name, header.version);
  }
  const std::size_t degree = b[12];
  if (degree > 4) fail_input("{}: SH of degree {}; 0 to 4 are supported", name, degree);
  if (b[13] > 23) fail_input("{}: {} fractional bits of 24", name, b[13]);
  header.rest = (degree + 1) * (degree + 1) - 1;
  header.fractional_bits = b[13];
  header.antialiased = (b[14] & kSpzAntialiased) != 0;
  return header;
}

Bytes read_block(GzipReader& in, std::size_t size) {
  Bytes bytes(size);
  in.read(bytes.data(), size);
  return bytes;
}

// Sign extension of 24 bits.
double fixed_point(const unsigned char* b) {
  const std::int32_t value = b[0] | b[1] << 8 | b[2] << 16;
  return value >= 1 << 23 ? value - (1 << 24) : value;
}

Four rotation_of(const unsigned char* b, const Header& header) {
  if (header.version == 3) return unpack_signed_rotation(little_endian(b));
  Four q{};
  double sum = 0.0;
  for (std::size_t i = 0; i < 3; ++i) {
    q[i] = b[i] / 127.5 - 1.0;
    sum += q[i] * q[i];
  }
  q[3] = std::sqrt(std::max(0.0, 1.0 - sum));
  return q;
}

void read_rotations(const Bytes& bytes, const Header& header, Splats& splats) {
  for (std::size_t i = 0; i < splats.count; ++i) {
    const Four xyzw = rotation_of(bytes.data() + header.rotation_bytes() * i, header);
    float* q = splats.quaternions.data() + 4 * i;
    q[0] = static_cast<float>(xyzw[3]);
    for (std::size_t c = 0; c < 3; ++c) q[c + 1] = kSpzAxes[c] * static_cast<float>(xyzw[c]);
  }
}

// In the file by Gaussian, then coefficient, then channel.
void read_sh(const Bytes& bytes, const Header& header, Splats& splats) {
  for (std::size_t i = 0; i < splats.count; ++i) {
    for (std::size_t k = 0; k < splats.rest; ++k) {
      for (std::size_t c = 0; c < 3; ++c) {
        const double byte = bytes[3 * (header.rest * i + k) + c];
        splats.sh_rest[3 * (splats.rest * i + k) + c] =
            kSpzShSigns[k] * static_cast<float>((byte - kSpzShScale) / kSpzShScale);
      }
    }
  }
}

}  // namespace

bool is_gzip(const Bytes& bytes) {
  return bytes.size() >= 2 && bytes[0] == 0x1f && bytes[1] == 0x8b;
}

SpzSplats read_spz(const Bytes& bytes, const std::string& name) {
  GzipReader in(bytes, name);
  const Header header = read_header(in, name);
  const std::size_t n = header.count;
  if (n * header.bytes_each() > kMaxInflation * bytes.size()) {
    fail_input("{}: the header states {} Gaussians, more than {} bytes can hold", name, n,
               bytes.size());
  }
  SpzSplats map{Splats(n, std::min(header.rest, kMaxRestCoefficients)), header.antialiased};
  Splats& splats = map.splats;
  const Bytes positions = read_block(in, 9 * n);
  const Bytes opacities = read_block(in, n);
  const Bytes colors = read_block(in, 3 * n);
  const Bytes scales = read_block(in, 3 * n);
  const double unit = std::ldexp(1.0, -header.fractional_bits);
  for (std::size_t i = 0; i < 3 * n; ++i) {
    splats.means[i] =
        kSpzAxes[i % 3] * static_cast<float>(unit * fixed_point(positions.data() + 3 * i));
    splats.sh_dc[i] = static_cast<float>((colors[i] / 255.0 - 0.5) / kSpzColorScale);
    splats.log_scales[i] = static_cast<float>(scales[i] / kSpzScaleSteps + kSpzMinLogScale);
  }
  for (std::size_t i = 0; i < n; ++i) splats.logit_opacities[i] = logit(opacities[i] / 255.0);
  read_rotations(read_block(in, header.rotation_bytes() * n), header, splats);
  read_sh(read_block(in, 3 * header.rest * n), header, splats);
  return map;
}

}  // namespace apvi::map_io
