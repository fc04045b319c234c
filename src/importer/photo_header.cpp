// SPDX-License-Identifier: BSD-3-Clause
#include "importer/photo_header.hpp"

#include <algorithm>
#include <chrono>
#include <fstream>
#include <string>
#include <vector>

#include "apvi/core/error.hpp"
#include "core/text.hpp"

namespace apvi::importer {
namespace {

// EXIF comes first and has at most 64 KiB; other segments before the size may be larger.
constexpr std::size_t kHeaderBytes = 1U << 20U;

constexpr std::uint16_t kExifIfd = 0x8769;
constexpr std::uint16_t kDateTimeOriginal = 0x9003;
constexpr std::uint16_t kSubSecTimeOriginal = 0x9291;
constexpr std::uint16_t kFocalLength35mm = 0xA405;

struct ExifText {
  std::string date;
  std::string fraction;
};

ByteReader at(Bytes tiff, ByteOrder order, std::size_t offset) {
  return ByteReader(offset <= tiff.size() ? tiff.subspan(offset) : Bytes{}, order);
}

struct IfdEntry {
  std::uint16_t tag = 0;
  std::uint32_t count = 0;
  std::uint16_t first_short = 0;
  std::uint32_t value = 0;   // or offset of the value
  std::size_t value_at = 0;  // of the four bytes themselves
};

std::vector<IfdEntry> read_ifd(Bytes tiff, ByteOrder order, std::size_t offset) {
  std::vector<IfdEntry> entries;
  ByteReader in = at(tiff, order, offset);
  for (std::uint16_t left = in.u16(); left > 0; --left) {
    IfdEntry e{.tag = in.u16()};
    in.skip(2);  // type
    e.count = in.u32();
    e.value_at = offset + in.position();
    e.value = in.u32();
    if (!in.ok()) break;
    e.first_short = at(tiff, order, e.value_at).u16();
    entries.push_back(e);
  }
  return entries;
}

std::string text_of(Bytes tiff, ByteOrder order, const IfdEntry& e) {
  const std::size_t count = std::min<std::size_t>(e.count, 64);
  std::string text = at(tiff, order, e.count <= 4 ? e.value_at : e.value).text(count);
  return text.substr(0, text.find('\0'));
}

// "2024:07:31 12:34:56" with a decimal fraction, as nanoseconds.
std::optional<std::int64_t> nanoseconds(const ExifText& exif) {
  if (exif.date.size() != 19) return std::nullopt;
  const auto number = [&](std::size_t from, std::size_t count) {
    return text::parse_int64(std::string_view(exif.date).substr(from, count)).value_or(-1);
  };
  namespace chrono = std::chrono;
  const chrono::year_month_day day(chrono::year(static_cast<int>(number(0, 4))),
                                   chrono::month(static_cast<unsigned>(number(5, 2))),
                                   chrono::day(static_cast<unsigned>(number(8, 2))));
  const std::int64_t hour = number(11, 2);
  const std::int64_t minute = number(14, 2);
  const std::int64_t second = number(17, 2);
  if (!day.ok() || day.year() < chrono::year(1970) || hour < 0 || minute < 0 || second < 0) {
    return std::nullopt;
  }
  const std::int64_t days = chrono::sys_days(day).time_since_epoch().count();
  const std::int64_t seconds = ((days * 24 + hour) * 60 + minute) * 60 + second;
  return text::parse_seconds_as_ns(std::to_string(seconds) + "." +
                                   (exif.fraction.empty() ? "0" : exif.fraction));
}

void read_exif(Bytes tiff, PhotoHeader& header) {
  ByteReader head(tiff);
  const std::string mark = head.text(2);
  if (mark != "II" && mark != "MM") return;
  const ByteOrder order = mark == "II" ? ByteOrder::little : ByteOrder::big;
  ExifText exif;
  for (const IfdEntry& entry : read_ifd(tiff, order, at(tiff, order, 4).u32())) {
    if (entry.tag != kExifIfd) continue;
    for (const IfdEntry& e : read_ifd(tiff, order, entry.value)) {
      if (e.tag == kDateTimeOriginal) exif.date = text_of(tiff, order, e);
      if (e.tag == kSubSecTimeOriginal) exif.fraction = text::trim(text_of(tiff, order, e));
      if (e.tag == kFocalLength35mm && e.first_short > 0) {
        header.focal_length_35mm = e.first_short;
      }
    }
  }
  header.taken_ns = nanoseconds(exif);
}

bool is_frame_header(std::uint8_t marker) {
  return marker >= 0xC0 && marker <= 0xCF && marker != 0xC4 && marker != 0xC8 && marker != 0xCC;
}

std::optional<PhotoHeader> parse_jpeg(Bytes file) {
  PhotoHeader header;
  ByteReader in(file);
  in.skip(2);
  while (in.left() >= 4) {
    if (in.u8() != 0xFF) return std::nullopt;
    std::uint8_t marker = in.u8();
    while (marker == 0xFF && in.ok()) marker = in.u8();  // any number of these may precede it
    if (marker == 0x01) continue;
    const std::size_t length = in.u16();
    if (length < 2) return std::nullopt;
    const Bytes segment = in.take(std::min(length - 2, in.left()));
    ByteReader part(segment);
    if (marker == 0xE1 && part.text(6) == std::string("Exif\0\0", 6)) {
      read_exif(segment.subspan(6), header);
    }
    if (!is_frame_header(marker)) continue;
    part.skip(1);  // precision
    header.size.height = part.u16();
    header.size.width = part.u16();
    if (!part.ok() || header.size.width == 0 || header.size.height == 0) return std::nullopt;
    return header;
  }
  return std::nullopt;
}

std::optional<PhotoHeader> parse_png(Bytes file) {
  ByteReader in(file);
  in.skip(16);
  const std::uint32_t width = in.u32();
  const std::uint32_t height = in.u32();
  constexpr std::uint32_t kMaxSide = 100'000;
  if (!in.ok() || width == 0 || height == 0 || width > kMaxSide || height > kMaxSide) {
    return std::nullopt;
  }
  return PhotoHeader{.size = {static_cast<int>(width), static_cast<int>(height)},
                     .taken_ns = {},
                     .focal_length_35mm = {}};
}

}  // namespace

std::optional<PhotoHeader> parse_photo_header(Bytes file) {
  ByteReader in(file);
  const std::string magic = in.text(8);
  if (magic == "\x89PNG\r\n\x1a\n") return parse_png(file);
  if (magic.starts_with("\xFF\xD8")) return parse_jpeg(file);
  return std::nullopt;
}

std::optional<PhotoHeader> read_photo_header(const std::filesystem::path& path) {
  std::ifstream in(path, std::ios::binary);
  if (!in) fail_input("{}: cannot be read; check its permissions", path.string());
  std::vector<std::uint8_t> head(kHeaderBytes);
  in.read(reinterpret_cast<char*>(head.data()), static_cast<std::streamsize>(head.size()));
  head.resize(static_cast<std::size_t>(in.gcount()));
  return parse_photo_header(head);
}

}  // namespace apvi::importer
