// SPDX-License-Identifier: BSD-3-Clause
#include "importer/mp4.hpp"

#include <algorithm>
#include <cmath>
#include <fstream>
#include <limits>

#include "apvi/core/error.hpp"
#include "importer/sample_table.hpp"

namespace apvi::importer {
namespace {

namespace fs = std::filesystem;

constexpr std::int64_t kUnixEpoch_s = 2'082'844'800;   // seconds from 1904 to 1970
constexpr std::uint64_t kMaxIndexBytes = 1ULL << 30U;  // an hour of 60 Hz has about 4 MB
constexpr std::uint32_t kMaxSampleBytes = 1U << 28U;

struct TrackTimes {
  std::uint32_t scale = 0;       // ticks per second of the track
  double empty_edit_s = 0.0;     // shown before the first sample
  std::int64_t media_start = 0;  // first tick that is shown
};

std::optional<std::int64_t> creation(Bytes mvhd) {
  ByteReader in(mvhd);
  const bool wide = in.u8() == 1;
  in.skip(3);
  const std::uint64_t seconds = wide ? in.u64() : in.u32();
  if (!in.ok() || seconds <= static_cast<std::uint64_t>(kUnixEpoch_s) || seconds > 1ULL << 33U) {
    return std::nullopt;
  }
  return static_cast<std::int64_t>(seconds) - kUnixEpoch_s;
}

// Ticks per second of `mvhd` and `mdhd`, which begin alike.
std::uint32_t timescale(Bytes header) {
  ByteReader in(header);
  in.skip(in.u8() == 1 ? 3 + 16 : 3 + 8);
  return in.u32();
}

void read_edits(Bytes elst, std::uint32_t movie_scale, TrackTimes& times) {
  ByteReader in(elst);
  const bool wide = in.u8() == 1;
  in.skip(3);
  for (std::uint32_t left = in.u32(); left > 0 && in.ok(); --left) {
    const std::uint64_t length = wide ? in.u64() : in.u32();
    const std::int64_t start = wide ? in.i64() : in.i32();
    in.skip(4);  // rate
    if (!in.ok()) return;
    if (start >= 0) {
      times.media_start = start;
      return;
    }
    if (movie_scale > 0) times.empty_edit_s += static_cast<double>(length) / movie_scale;
  }
}

std::string handler_of(Bytes hdlr) {
  ByteReader in(hdlr);
  in.skip(8);
  return in.fourcc();
}

std::string format_of(Bytes stsd) {
  ByteReader in(stsd);
  in.skip(12);
  return in.fourcc();
}

void place(Mp4Track& track, const std::vector<TableSample>& table, const TrackTimes& times) {
  const auto seconds = [&](std::int64_t ticks) { return static_cast<double>(ticks) / times.scale; };
  track.samples.reserve(table.size());
  for (const TableSample& s : table) {
    // Through double: files may hold any 64-bit number.
    const double time = seconds(s.time) - seconds(times.media_start) + times.empty_edit_s;
    track.samples.push_back({s.offset, s.size, time, seconds(s.duration)});
  }
}

Mp4Track parse_track(Bytes trak, std::uint32_t movie_scale, const std::string& name) {
  Mp4Track track;
  TrackTimes times;
  if (const auto elst = find_box(trak, {"edts", "elst"})) {
    read_edits(*elst, movie_scale, times);
    track.shown_from_s = times.empty_edit_s;
  }
  if (const auto mdhd = find_box(trak, {"mdia", "mdhd"})) times.scale = timescale(*mdhd);
  if (const auto hdlr = find_box(trak, {"mdia", "hdlr"})) track.handler = handler_of(*hdlr);
  const auto stbl = find_box(trak, {"mdia", "minf", "stbl"});
  if (!stbl) return track;
  if (const auto stsd = find_box(*stbl, {"stsd"})) track.format = format_of(*stsd);
  // Uncompressed sound has millions of samples, which nothing needs.
  if (track.handler != "vide" && track.format != "gpmd") return track;
  const std::vector<TableSample> table = read_sample_table(*stbl, name);
  if (!table.empty() && times.scale == 0) {
    fail_input("{}: a track has no time scale; the file is damaged", name);
  }
  place(track, table, times);
  return track;
}

}  // namespace

double Mp4Track::first_s() const {
  double first = std::numeric_limits<double>::infinity();
  for (const Mp4Sample& s : samples) {
    if (s.time_s >= shown_from_s) first = std::min(first, s.time_s);
  }
  return std::isfinite(first) ? first : 0.0;
}

const Mp4Track* Mp4Movie::with_handler(const std::string& handler) const {
  const auto it = std::find_if(tracks.begin(), tracks.end(),
                               [&](const Mp4Track& t) { return t.handler == handler; });
  return it == tracks.end() ? nullptr : &*it;
}

const Mp4Track* Mp4Movie::with_format(const std::string& format) const {
  const auto it = std::find_if(tracks.begin(), tracks.end(),
                               [&](const Mp4Track& t) { return t.format == format; });
  return it == tracks.end() ? nullptr : &*it;
}

Mp4Movie parse_moov(Bytes moov, const std::string& name) {
  Mp4Movie movie;
  std::uint32_t scale = 0;
  if (const auto mvhd = find_box(moov, {"mvhd"})) {
    movie.created_unix_s = creation(*mvhd);
    scale = timescale(*mvhd);
  }
  for_each_box(moov, [&](const std::string& type, Bytes content) {
    if (type == "trak") movie.tracks.push_back(parse_track(content, scale, name));
  });
  if (const auto gpmf = find_box(moov, {"udta", "GPMF"})) movie.gpmf = {gpmf->begin(), gpmf->end()};
  return movie;
}

bool is_mp4(const fs::path& path) {
  std::string head(12, '\0');
  std::ifstream(path, std::ios::binary).read(head.data(), 12);
  const std::string type = head.substr(4, 4);
  const auto known = {"ftyp", "moov", "mdat", "wide", "free", "skip"};
  return std::find(known.begin(), known.end(), type) != known.end();
}

Mp4Movie read_mp4(const fs::path& path) {
  std::ifstream in(path, std::ios::binary);
  if (!in) fail_input("{}: cannot be read; check that it exists", path.string());
  std::error_code ignored;
  const std::uint64_t size = fs::file_size(path, ignored);
  for (std::uint64_t at = 0; at + 8 <= size;) {
    std::vector<std::uint8_t> head(16);
    in.clear();
    in.seekg(static_cast<std::streamoff>(at));
    in.read(reinterpret_cast<char*>(head.data()), 16);
    const BoxHeader box = read_box_header(head, size - at);
    if (box.total == 0) break;  // damaged
    if (box.type == "moov") {
      if (box.total > kMaxIndexBytes) fail_input("{}: its index is damaged", path.string());
      std::vector<std::uint8_t> moov(box.total - box.header);
      in.clear();
      in.seekg(static_cast<std::streamoff>(at + box.header));
      in.read(reinterpret_cast<char*>(moov.data()), static_cast<std::streamsize>(moov.size()));
      if (!in) fail_input("{}: its index cannot be read", path.string());
      return parse_moov(moov, path.string());
    }
    at += box.total;
  }
  fail_input("{}: has no index (moov box): the recording was interrupted; repair it first",
             path.string());
}

std::vector<std::uint8_t> read_sample(std::istream& file, const Mp4Sample& sample,
                                      const std::string& name) {
  constexpr auto kMaxOffset = static_cast<std::uint64_t>(std::numeric_limits<std::int64_t>::max());
  if (sample.size > kMaxSampleBytes || sample.offset > kMaxOffset) {
    fail_input("{}: a telemetry sample of {} bytes at {}; the file is damaged", name, sample.size,
               sample.offset);
  }
  std::vector<std::uint8_t> bytes(sample.size);
  file.clear();
  file.seekg(static_cast<std::streamoff>(sample.offset));
  file.read(reinterpret_cast<char*>(bytes.data()), static_cast<std::streamsize>(bytes.size()));
  if (!file) fail_input("{}: ends within the telemetry; the file is incomplete", name);
  return bytes;
}

}  // namespace apvi::importer
