// SPDX-License-Identifier: BSD-3-Clause
#include <bit>
#include <cstdint>
#include <fstream>
#include <string>
#include <string_view>

#include "apvi/core/error.hpp"
#include "core/atomic_file.hpp"
#include "loop_closure/place_map.hpp"

namespace apvi::loop_closure {
namespace {

static_assert(std::endian::native == std::endian::little);

constexpr std::string_view kMagic = "APVI places\n";
constexpr std::uint32_t kVersion = 1;
// What describes a feature; descriptors of another kind cannot be compared.
constexpr std::string_view kFeatures = "sift 128 u8 clahe";
constexpr std::uint32_t kMaxCount = 10'000'000;

template <typename T>
void put(std::ostream& out, const T& value) {
  out.write(reinterpret_cast<const char*>(&value), sizeof(T));
}

/// Reads values and throws at the end of the file.
class Reader {
 public:
  explicit Reader(const std::filesystem::path& path) : path_(path), in_(path, std::ios::binary) {}

  bool opened() const { return in_.is_open(); }
  void bytes(void* to, std::size_t size) {
    in_.read(static_cast<char*>(to), static_cast<std::streamsize>(size));
    if (!in_) fail_input("{}: damaged: the file ends early; run the dive again", path_.string());
  }
  template <typename T>
  T get() {
    T value{};
    bytes(&value, sizeof(T));
    return value;
  }
  std::uint32_t count() {
    const auto n = get<std::uint32_t>();
    if (n > kMaxCount) fail_input("{}: damaged; run the dive again", path_.string());
    return n;
  }
  std::string text(std::size_t size) {
    std::string value(size, '\0');
    bytes(value.data(), size);
    return value;
  }

 private:
  std::filesystem::path path_;
  std::ifstream in_;
};

void check_header(Reader& reader, const std::filesystem::path& path) {
  if (reader.text(kMagic.size()) != kMagic) {
    fail_input("{}: not a file of places", path.string());
  }
  const auto version = reader.get<std::uint32_t>();
  const std::string features = reader.text(reader.count());
  if (version == kVersion && features == kFeatures) return;
  fail_input(
      "{}: version {} with features '{}', this program reads version {} with '{}'; run the dive of "
      "the map again with this program",
      path.string(), version, features, kVersion, kFeatures);
}

void put(std::ostream& out, const MapPlace& place) {
  put(out, place.stamp.ns);
  const Eigen::Vector4d q = place.T_map_camera.rotation.coeffs();
  for (const double x : place.T_map_camera.translation) put(out, x);
  for (const double x : q) put(out, x);
  put(out, static_cast<std::uint32_t>(place.points.size()));
  for (const Eigen::Vector3f& point : place.points) {
    for (const float x : point) put(out, x);
  }
  for (int row = 0; row < place.descriptors.rows; ++row) {
    out.write(place.descriptors.ptr<char>(row), kDescriptorSize);
  }
}

MapPlace read_place(Reader& reader) {
  MapPlace place;
  place.stamp.ns = reader.get<std::int64_t>();
  for (double& x : place.T_map_camera.translation) x = reader.get<double>();
  for (double& x : place.T_map_camera.rotation.coeffs()) x = reader.get<double>();
  place.points.resize(reader.count());
  for (Eigen::Vector3f& point : place.points) {
    for (float& x : point) x = reader.get<float>();
  }
  place.descriptors.create(static_cast<int>(place.points.size()), kDescriptorSize, CV_8U);
  for (int row = 0; row < place.descriptors.rows; ++row) {
    reader.bytes(place.descriptors.ptr(row), kDescriptorSize);
  }
  return place;
}

}  // namespace

void save(const PlaceMap& map, const std::filesystem::path& path) {
  write_file_atomically(path, [&](std::ostream& out) {
    out << kMagic;
    put(out, kVersion);
    put(out, static_cast<std::uint32_t>(kFeatures.size()));
    out << kFeatures;
    put(out, static_cast<std::uint32_t>(map.places.size()));
    for (const MapPlace& place : map.places) put(out, place);
  });
}

std::filesystem::path find_place_map(const std::filesystem::path& run) {
  if (!std::filesystem::is_directory(run)) {
    fail_input("{}: no such run folder to be found in", run.string());
  }
  std::filesystem::path file = run / kPlacesFile;
  if (!std::filesystem::exists(file)) {
    fail_input(
        "{}: no {}: the run was made by an older version, without a camera or an IMU, or with "
        "smoothing.enabled: false; run its dive again",
        run.string(), kPlacesFile);
  }
  Reader reader(file);
  check_header(reader, file);
  if (reader.count() == 0) {
    fail_input("{}: no places: vision was never stable in that dive", file.string());
  }
  return file;
}

PlaceMap load_place_map(const std::filesystem::path& path) {
  Reader reader(path);
  if (!reader.opened()) fail_input("{}: cannot be read", path.string());
  check_header(reader, path);
  PlaceMap map;
  const std::uint32_t count = reader.count();
  for (std::uint32_t k = 0; k < count; ++k) map.places.push_back(read_place(reader));
  return map;
}

}  // namespace apvi::loop_closure
