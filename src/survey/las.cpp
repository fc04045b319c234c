// SPDX-License-Identifier: BSD-3-Clause
#include "survey/las.hpp"

#include <torch/torch.h>

#include <array>
#include <cmath>
#include <concepts>
#include <cstdint>
#include <cstring>
#include <ostream>
#include <string>
#include <string_view>

#include "apvi/core/error.hpp"
#include "apvi/version.hpp"
#include "core/atomic_file.hpp"

namespace apvi::survey {
namespace {

constexpr double kStep_m = 1e-4;
constexpr double kMaxExtent_m = 2e5;  // in steps within 32 bits
constexpr std::uint16_t kHeaderSize = 375;
constexpr std::uint16_t kRecordHeaderSize = 54;
constexpr std::uint8_t kPointFormat = 7;
constexpr std::uint16_t kPointSize = 36;
constexpr std::uint16_t kWktFlag = 16;        // bit 4 of the global encoding
constexpr std::uint16_t kWktRecord = 2112;    // OGC coordinate system WKT
constexpr std::uint8_t kSingleReturn = 0x11;  // the first of one

/// Little-endian fields one after the other.
class Fields {
 public:
  template <typename T>
  requires std::integral<T> || std::floating_point<T> Fields& put(T value) {
    std::array<char, sizeof(T)> raw{};
    std::memcpy(raw.data(), &value, sizeof(T));
    text_.append(raw.data(), raw.size());
    return *this;
  }
  /// Text of a fixed size, padded with zeros.
  Fields& put(std::string_view text, std::size_t size) {
    const std::string_view part = text.substr(0, size);
    text_.append(part).append(size - part.size(), '\0');
    return *this;
  }
  const std::string& text() const { return text_; }

 private:
  std::string text_;
};

struct Extent {
  std::array<double, 3> offset{};
  std::array<double, 3> low{};
  std::array<double, 3> high{};
};

Extent extent_of(const SurfacePoints& points) {
  Extent extent;
  for (int axis = 0; axis < 3; ++axis) {
    const auto i = static_cast<std::size_t>(axis);
    const torch::Tensor values = points.positions.select(1, axis);
    const bool empty = values.numel() == 0;
    const double low = points.anchor[axis] + (empty ? 0.0 : values.min().item<double>());
    const double high = points.anchor[axis] + (empty ? 0.0 : values.max().item<double>());
    if (high - low > kMaxExtent_m) {
      fail_input("LAS: the points span more than 200 km; remove outliers of the map");
    }
    extent.offset[i] = std::floor(low);
    const auto rounded = [&](double value) {
      return extent.offset[i] + kStep_m * std::round((value - extent.offset[i]) / kStep_m);
    };
    extent.low[i] = rounded(low);
    extent.high[i] = rounded(high);
  }
  return extent;
}

std::string header(const Extent& extent, std::uint64_t count, std::size_t wkt_size) {
  Fields f;
  f.put("LASF", 4).put(std::uint16_t{0}).put(kWktFlag).put("", 16);
  f.put(std::uint8_t{1}).put(std::uint8_t{4});
  f.put("apvi export", 32).put(std::string("APVI-SLAM ") + kVersion, 32);
  f.put(std::uint16_t{0}).put(std::uint16_t{0});  // no date: files of a map are equal
  f.put(kHeaderSize).put(static_cast<std::uint32_t>(kHeaderSize + kRecordHeaderSize + wkt_size));
  f.put(std::uint32_t{1}).put(kPointFormat).put(kPointSize);
  f.put("", 24);  // counts of older versions: none with this point format
  for (int axis = 0; axis < 3; ++axis) f.put(kStep_m);
  for (const double offset : extent.offset) f.put(offset);
  for (std::size_t i = 0; i < 3; ++i) f.put(extent.high[i]).put(extent.low[i]);
  f.put(std::uint64_t{0}).put(std::uint64_t{0}).put(std::uint32_t{0});
  f.put(count).put(count).put("", 14 * 8);  // all of them are first returns
  return f.text();
}

std::string wkt_record(const std::string& wkt) {
  Fields f;
  f.put(std::uint16_t{0}).put("LASF_Projection", 16).put(kWktRecord);
  f.put(static_cast<std::uint16_t>(wkt.size() + 1)).put("WKT", 32).put(wkt, wkt.size() + 1);
  return f.text();
}

std::string point(const double* position, const float* color, const SurfacePoints& points,
                  const Extent& extent) {
  Fields f;
  for (int axis = 0; axis < 3; ++axis) {
    const double value =
        position[axis] + (points.anchor[axis] - extent.offset[static_cast<std::size_t>(axis)]);
    f.put(static_cast<std::int32_t>(std::llround(value / kStep_m)));
  }
  f.put(std::uint16_t{0}).put(kSingleReturn).put(std::uint8_t{0});
  f.put(std::uint8_t{1}).put(std::uint8_t{0}).put(std::int16_t{0}).put(std::uint16_t{0}).put(0.0);
  for (int channel = 0; channel < 3; ++channel) {
    f.put(static_cast<std::uint16_t>(std::lround(65535.0F * color[channel])));
  }
  return f.text();
}

}  // namespace

void write_las(const std::filesystem::path& file, const SurfacePoints& points,
               const Georeference& reference) {
  const Extent extent = extent_of(points);
  const std::string wkt = well_known_text(reference.epsg);
  const std::int64_t count = points.positions.size(0);
  write_file_atomically(file, [&](std::ostream& out) {
    out << header(extent, static_cast<std::uint64_t>(count), wkt.size() + 1) << wkt_record(wkt);
    const double* position = points.positions.data_ptr<double>();
    const float* color = points.colors.data_ptr<float>();
    for (std::int64_t i = 0; i < count; ++i, position += 3, color += 3) {
      out << point(position, color, points, extent);
    }
  });
}

}  // namespace apvi::survey
