// SPDX-License-Identifier: BSD-3-Clause
#include "core/foreign_file.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <fstream>
#include <initializer_list>
#include <string_view>
#include <system_error>

#include "core/text.hpp"

namespace apvi {
namespace {

namespace fs = std::filesystem;
using namespace std::string_view_literals;

struct Kind {
  std::string_view begin;
  std::string_view text;
};

constexpr std::array<Kind, 8> kByContent = {{
    {"PK\x03\x04"sv, "a zip archive: unpack it and name what is in it"},
    {"7z\xBC\xAF\x27\x1C"sv, "a 7z archive: unpack it and name what is in it"},
    {"Rar!"sv, "a rar archive: unpack it and name what is in it"},
    {"\x1F\x8B"sv, "compressed by gzip: unpack it (gunzip, or tar -xzf) and name what is in it"},
    {"\xFD\x37zXZ"sv, "compressed by xz: unpack it (unxz, or tar -xJf) and name what is in it"},
    {"BZh"sv, "compressed by bzip2: unpack it (bunzip2, or tar -xjf) and name what is in it"},
    {"\x28\xB5\x2F\xFD"sv, "compressed as a whole file: zstd -d FILE, and name the result"},
    {"%PDF"sv, "a PDF document"},
}};

bool is_one_of(std::string_view word, std::initializer_list<std::string_view> words) {
  return std::find(words.begin(), words.end(), word) != words.end();
}

std::string first_bytes(const fs::path& file) {
  std::string bytes(512, '\0');
  std::ifstream in(file, std::ios::binary);
  in.read(bytes.data(), static_cast<std::streamsize>(bytes.size()));
  bytes.resize(static_cast<std::size_t>(in.gcount()));
  return bytes;
}

// The ending says ROS 1, the content ROS 2.
std::optional<std::string> misnamed_bag(std::string_view bytes, std::string_view extension) {
  if (bytes.starts_with("SQLite format 3") && extension != ".db3") {
    return "an sqlite3 database: if it is a bag of ROS 2, let its name end in .db3";
  }
  if (bytes.starts_with("\x89MCAP") && extension != ".mcap") {
    return "an MCAP file, as ROS 2 records them: let its name end in .mcap";
  }
  return std::nullopt;
}

std::optional<std::string> by_name(std::string_view extension) {
  if (is_one_of(extension, {".h264", ".264", ".avc", ".h265", ".265", ".hevc"})) {
    return "a raw video stream, which has no time of its images: put it into a container at its "
           "frame rate, ffmpeg -framerate 30 -i FILE -c copy dive.mp4, and import that";
  }
  if (is_one_of(extension, {".splat", ".ksplat", ".sog"})) {
    return fmt::format(
        "a {} map, reduced for viewers in a browser: export it as .ply, .compressed.ply or .spz "
        "from the program that made it, or with SuperSplat",
        extension);
  }
  if (is_one_of(extension, {".ply", ".spz"})) {
    return "a map or a point cloud: `apvi view` and `apvi render` show maps";
  }
  if (is_one_of(extension, {".jpg", ".jpeg", ".png", ".tif", ".tiff", ".bmp", ".dng", ".raw"})) {
    return "an image: name the folder of the images";
  }
  if (is_one_of(extension, {".csv", ".jsonl"})) {
    return "one file of a recording: name the folder that has all of them, see docs/formats.md";
  }
  return std::nullopt;
}

}  // namespace

std::optional<std::string> describe_foreign_file(const fs::path& file) {
  std::error_code unreadable;
  if (!fs::is_regular_file(file, unreadable)) return std::nullopt;
  const std::string bytes = first_bytes(file);
  const std::string extension = text::to_lower(file.extension().string());
  if (bytes.empty()) return "an empty file: copy or record it again";
  const bool only_zeros = bytes.find_first_not_of('\0') == std::string::npos;
  if (only_zeros && bytes.size() > 64) {
    return "begins with zeros only: its recording or copy was interrupted; copy or record it again";
  }
  if (auto bag = misnamed_bag(bytes, extension)) return bag;
  const auto* kind = std::find_if(kByContent.begin(), kByContent.end(), [&](const Kind& k) {
    return bytes.starts_with(k.begin) && extension != ".spz";  // a map that is compressed by gzip
  });
  if (kind != kByContent.end()) return std::string(kind->text);
  return by_name(extension);
}

}  // namespace apvi
