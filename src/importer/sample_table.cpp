// SPDX-License-Identifier: BSD-3-Clause
#include "importer/sample_table.hpp"

#include <algorithm>

#include "apvi/core/error.hpp"

namespace apvi::importer {
namespace {

// A table of samples of one size may claim any number without holding them. 4.6 hours at 60 Hz.
constexpr std::uint32_t kMaxEqualSamples = 1'000'000;

// Reader after version and flags.
ByteReader table(Bytes box) {
  ByteReader in(box);
  in.skip(4);
  return in;
}

void read_sizes(Bytes stsz, std::vector<TableSample>& samples, const std::string& name) {
  ByteReader in = table(stsz);
  const std::uint32_t common = in.u32();
  const std::uint32_t count = in.u32();
  const std::uint64_t most = common != 0 ? kMaxEqualSamples : in.left() / 4;
  if (count > most) {
    fail_input("{}: a track claims {} samples; the file is damaged", name, count);
  }
  samples.resize(count);
  for (TableSample& s : samples) s.size = common != 0 ? common : in.u32();
}

std::vector<std::uint64_t> chunk_offsets(Bytes stbl) {
  std::vector<std::uint64_t> offsets;
  const auto stco = find_box(stbl, {"stco"});
  const auto wide = find_box(stbl, {"co64"});
  if (!stco && !wide) return offsets;
  ByteReader in = table(stco ? *stco : *wide);
  for (std::uint32_t left = in.u32(); left > 0; --left) {
    const std::uint64_t offset = stco ? in.u32() : in.u64();
    if (!in.ok()) break;
    offsets.push_back(offset);
  }
  return offsets;
}

struct ChunkRun {
  std::uint32_t first = 0;  // from 1
  std::uint32_t per_chunk = 0;
};

std::vector<ChunkRun> chunk_runs(Bytes stsc) {
  std::vector<ChunkRun> runs;
  ByteReader in = table(stsc);
  for (std::uint32_t left = in.u32(); left > 0; --left) {
    const std::uint32_t first = in.u32();
    const std::uint32_t per_chunk = in.u32();
    in.skip(4);  // sample description
    if (!in.ok()) break;
    runs.push_back({first, per_chunk});
  }
  return runs;
}

// Samples of a chunk lie one after the other.
void read_offsets(Bytes stbl, std::vector<TableSample>& samples, const std::string& name) {
  const std::vector<std::uint64_t> chunks = chunk_offsets(stbl);
  const auto stsc = find_box(stbl, {"stsc"});
  const std::vector<ChunkRun> runs = stsc ? chunk_runs(*stsc) : std::vector<ChunkRun>{};
  std::size_t next = 0;
  std::size_t run = 0;
  for (std::size_t c = 0; c < chunks.size() && next < samples.size() && !runs.empty(); ++c) {
    while (run + 1 < runs.size() && c + 1 >= runs[run + 1].first) ++run;
    std::uint64_t at = chunks[c];
    for (std::uint32_t i = 0; i < runs[run].per_chunk && next < samples.size(); ++i, ++next) {
      samples[next].offset = at;
      at += samples[next].size;
    }
  }
  if (next < samples.size()) {
    fail_input("{}: {} of {} samples of a track have no place; the file is damaged", name,
               samples.size() - next, samples.size());
  }
}

void read_times(Bytes stts, std::vector<TableSample>& samples) {
  ByteReader in = table(stts);
  std::int64_t time = 0;
  std::size_t next = 0;
  for (std::uint32_t left = in.u32(); left > 0 && in.ok(); --left) {
    const std::uint32_t count = in.u32();
    const std::uint32_t duration = in.u32();
    for (std::uint32_t i = 0; i < count && next < samples.size(); ++i, ++next) {
      samples[next].time = time;
      samples[next].duration = duration;
      time += duration;
    }
  }
  for (; next < samples.size(); ++next) samples[next].time = time;
}

// Reordered images are shown later than they are decoded.
void add_composition_offsets(Bytes ctts, std::vector<TableSample>& samples) {
  ByteReader in = table(ctts);
  std::size_t next = 0;
  for (std::uint32_t left = in.u32(); left > 0 && in.ok(); --left) {
    const std::uint32_t count = in.u32();
    const std::int32_t offset = in.i32();
    for (std::uint32_t i = 0; i < count && next < samples.size(); ++i) {
      samples[next++].time += offset;
    }
  }
}

}  // namespace

BoxHeader read_box_header(Bytes head, std::uint64_t left) {
  ByteReader in(head);
  std::uint64_t total = in.u32();
  BoxHeader box{.type = in.fourcc(), .total = 0, .header = 8};
  if (total == 1) {
    total = in.u64();
    box.header = 16;
  }
  if (total == 0) total = left;  // to the end
  if (in.ok() && total >= box.header && left >= box.header) box.total = std::min(total, left);
  return box;
}

void for_each_box(Bytes boxes, const std::function<void(const std::string&, Bytes)>& visit) {
  while (boxes.size() >= 8) {
    const BoxHeader box = read_box_header(boxes, boxes.size());
    if (box.total == 0) return;
    visit(box.type, boxes.subspan(box.header, box.total - box.header));
    boxes = boxes.subspan(box.total);
  }
}

std::optional<Bytes> find_box(Bytes boxes, std::initializer_list<const char*> path) {
  std::optional<Bytes> found = boxes;
  for (const char* wanted : path) {
    const Bytes parent = *found;
    found.reset();
    for_each_box(parent, [&](const std::string& type, Bytes content) {
      if (!found && type == wanted) found = content;
    });
    if (!found) return found;
  }
  return found;
}

std::vector<TableSample> read_sample_table(Bytes stbl, const std::string& name) {
  std::vector<TableSample> samples;
  const auto stsz = find_box(stbl, {"stsz"});
  if (!stsz) return samples;
  read_sizes(*stsz, samples, name);
  read_offsets(stbl, samples, name);
  if (const auto stts = find_box(stbl, {"stts"})) read_times(*stts, samples);
  if (const auto ctts = find_box(stbl, {"ctts"})) add_composition_offsets(*ctts, samples);
  return samples;
}

}  // namespace apvi::importer
