// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <array>
#include <bit>
#include <cstdint>
#include <string>
#include <utility>
#include <vector>

#include "importer/byte_reader.hpp"

/// Writers of small MP4 files and GPMF payloads.
namespace apvi::test {

inline importer::Bytes as_bytes(const std::string& text) {
  return {reinterpret_cast<const std::uint8_t*>(text.data()), text.size()};
}

/// A number, most significant byte first.
template <typename T>
std::string big(T value) {
  std::string text;
  for (std::size_t i = sizeof(T); i-- > 0;) text += static_cast<char>(value >> 8 * i & 0xFF);
  return text;
}
inline std::string u32(std::uint32_t value) {
  return big(value);
}

inline std::string box(const std::string& type, const std::string& content) {
  return u32(static_cast<std::uint32_t>(content.size() + 8)) + type + content;
}
/// With version and flags of zero.
inline std::string full_box(const std::string& type, const std::string& content) {
  return box(type, u32(0) + content);
}

struct TrackBytes {
  std::string handler = "meta";
  std::string format = "gpmd";
  std::uint32_t timescale = 1000;
  std::uint32_t sample_ticks = 1000;
  std::vector<std::uint32_t> sizes = {};          ///< of the samples [bytes]
  std::vector<std::uint32_t> chunk_offsets = {};  ///< in the file
  std::uint32_t samples_per_chunk = 1;
  std::vector<std::int32_t> composition_offsets = {};
  std::string edits = {};  ///< content of elst after its count
  std::uint32_t edit_count = 0;
};

inline std::string table(const std::vector<std::uint32_t>& numbers) {
  std::string text = u32(static_cast<std::uint32_t>(numbers.size()));
  for (const std::uint32_t n : numbers) text += u32(n);
  return text;
}

inline std::string trak(const TrackBytes& t) {
  const auto count = static_cast<std::uint32_t>(t.sizes.size());
  std::string stbl = full_box("stsd", u32(1) + u32(16) + t.format + std::string(8, '\0'));
  stbl += full_box("stts", u32(1) + u32(count) + u32(t.sample_ticks));
  if (!t.composition_offsets.empty()) {
    std::string rows = u32(static_cast<std::uint32_t>(t.composition_offsets.size()));
    for (const std::int32_t o : t.composition_offsets) {
      rows += u32(1) + u32(static_cast<std::uint32_t>(o));
    }
    stbl += full_box("ctts", rows);
  }
  stbl += full_box("stsc", u32(1) + u32(1) + u32(t.samples_per_chunk) + u32(1));
  stbl += full_box("stsz", u32(0) + table(t.sizes));
  stbl += full_box("stco", table(t.chunk_offsets));
  const std::string mdhd =
      full_box("mdhd", u32(0) + u32(0) + u32(t.timescale) + u32(count * t.sample_ticks) + u32(0));
  const std::string hdlr = full_box("hdlr", u32(0) + t.handler + std::string(12, '\0'));
  std::string content;
  if (t.edit_count > 0) content += box("edts", full_box("elst", u32(t.edit_count) + t.edits));
  return box("trak", content + box("mdia", mdhd + hdlr + box("minf", box("stbl", stbl))));
}

/// `created` counts seconds from 1904.
inline std::string mvhd(std::uint32_t created = 0, std::uint32_t timescale = 1000) {
  return full_box("mvhd", u32(created) + u32(created) + u32(timescale) + std::string(84, '\0'));
}

/// A GPMF item of `count` elements of `element_size` bytes.
inline std::string klv(const std::string& key, char type, std::size_t element_size,
                       std::size_t count, const std::string& data) {
  std::string item =
      key + type + static_cast<char>(element_size) + big(static_cast<std::uint16_t>(count)) + data;
  while (item.size() % 4 != 0) item += '\0';
  return item;
}
inline std::string klv_text(const std::string& key, const std::string& text) {
  return klv(key, 'c', 1, text.size(), text);
}
inline std::string nest(const std::string& key, const std::string& items) {
  return klv(key, '\0', 1, items.size(), items);
}
inline std::string i16(int value) {
  return big(static_cast<std::uint16_t>(value));
}
inline std::string f32(float value) {
  return u32(std::bit_cast<std::uint32_t>(value));
}
inline std::string stamp_us(std::uint64_t us) {
  return klv("STMP", 'J', 8, 1, big(us));
}

/// A stream of three 16-bit channels.
struct SensorBytes {
  std::string key = "GYRO";
  std::string before = {};  ///< items before the data: STMP, ORIN, SIUN
  int scale = 100;
  std::vector<std::array<int, 3>> samples = {};
};

inline std::string sensor_stream(const SensorBytes& s) {
  std::string data;
  for (const auto& sample : s.samples) {
    for (const int channel : sample) data += i16(channel);
  }
  return nest("STRM", s.before + klv("SCAL", 's', 2, 1, i16(s.scale)) +
                          klv(s.key, 's', 6, s.samples.size(), data));
}

inline std::string shutter_stream(const std::string& before, const std::vector<float>& seconds) {
  std::string data;
  for (const float s : seconds) data += f32(s);
  return nest("STRM", before + klv("SHUT", 'f', 4, seconds.size(), data));
}

inline std::string device(const std::string& streams, const std::string& name = "HERO10 Black") {
  return nest("DEVC", klv_text("DVNM", name) + streams);
}

/// Adds a telemetry track to a complete MP4 file whose last box is `moov`: one payload per second.
inline std::string with_telemetry(const std::string& mp4,
                                  const std::vector<std::string>& payloads) {
  std::size_t moov = 0;
  for (std::size_t at = 0; at + 8 <= mp4.size();) {
    importer::ByteReader in(as_bytes(mp4).subspan(at));
    const std::size_t size = in.u32();
    moov = at;
    if (in.fourcc() == "moov" || size < 8) break;
    at += size;
  }
  TrackBytes track;
  std::string data;
  for (const std::string& p : payloads) {
    track.sizes.push_back(static_cast<std::uint32_t>(p.size()));
    data += p;
  }
  track.samples_per_chunk = static_cast<std::uint32_t>(payloads.size());
  track.chunk_offsets = {0};
  const std::size_t grown = mp4.size() + trak(track).size();
  track.chunk_offsets = {static_cast<std::uint32_t>(grown + 8)};
  return mp4.substr(0, moov) + box("moov", mp4.substr(moov + 8) + trak(track)) + box("mdat", data);
}

}  // namespace apvi::test
