// SPDX-License-Identifier: BSD-3-Clause
#include "importer/gpmf.hpp"

#include <algorithm>
#include <cmath>

namespace apvi::importer {
namespace {

constexpr int kMaxDepth = 8;

std::size_t number_size(char type) {
  switch (type) {
    case 'b':
    case 'B':
      return 1;
    case 's':
    case 'S':
      return 2;
    case 'l':
    case 'L':
    case 'f':
    case 'q':
      return 4;
    case 'j':
    case 'J':
    case 'd':
    case 'Q':
      return 8;
    default:
      return 0;
  }
}

double read_number(ByteReader& in, char type) {
  switch (type) {
    case 'b':
      return static_cast<std::int8_t>(in.u8());
    case 'B':
      return in.u8();
    case 's':
      return static_cast<std::int16_t>(in.u16());
    case 'S':
      return in.u16();
    case 'l':
      return in.i32();
    case 'L':
      return in.u32();
    case 'f':
      return in.f32();
    case 'q':  // fixed point, 16 bits after the point
      return in.i32() / 65536.0;
    case 'j':
      return static_cast<double>(in.i64());
    case 'J':
      return static_cast<double>(in.u64());
    case 'Q':  // fixed point, 32 bits after the point
      return static_cast<double>(in.i64()) / 4294967296.0;
    default:
      return in.f64();
  }
}

bool is_sensor(const std::string& key) {
  const auto known = {"ACCL", "GYRO", "SHUT", "ISOE", "ISOG", "WBAL", "WRGB", "IORI"};
  return std::find(known.begin(), known.end(), key) != known.end();
}

std::optional<double> first_number(const GpmfItem& item) {
  const std::vector<double> numbers = numbers_of(item);
  if (numbers.empty() || !std::isfinite(numbers.front())) return std::nullopt;
  return numbers.front();
}

void set_data(const GpmfItem& item, GpmfStream& stream) {
  const std::size_t bytes = number_size(item.type);
  if (bytes == 0 || item.element_size % bytes != 0) return;
  stream.key = item.key;
  stream.channels = item.element_size / bytes;
  stream.values = numbers_of(item);
}

// SCAL divides: one number for all channels, or one for each.
void divide(GpmfStream& stream, const std::vector<double>& scale) {
  if (scale.empty()) return;
  for (std::size_t i = 0; i < stream.values.size(); ++i) {
    const double divisor = scale[scale.size() == stream.channels ? i % stream.channels : 0];
    if (divisor != 0.0) stream.values[i] /= divisor;
  }
}

GpmfStream parse_stream(Bytes items) {
  GpmfStream stream;
  std::vector<double> scale;
  for_each_item(items, [&](const GpmfItem& item) {
    if (item.key == "SCAL") scale = numbers_of(item);
    if (item.key == "SIUN" || item.key == "UNIT") stream.unit = text_of(item);
    if (item.key == "ORIN") stream.orientation_in = text_of(item);
    if (item.key == "ORIO") stream.orientation_out = text_of(item);
    if (item.key == "MTRX") stream.matrix = numbers_of(item);
    if (item.key == "STMP") {
      if (const auto us = first_number(item)) stream.stamp_s = 1e-6 * *us;
    }
    if (is_sensor(item.key)) set_data(item, stream);
  });
  divide(stream, scale);
  return stream;
}

void parse_device(Bytes items, GpmfPayload& payload) {
  for_each_item(items, [&](const GpmfItem& item) {
    if (item.key == "DVNM" && payload.device.empty()) payload.device = text_of(item);
    if (item.key != "STRM" || item.type != 0) return;
    GpmfStream stream = parse_stream(item.data);
    if (!stream.key.empty()) payload.streams.push_back(std::move(stream));
  });
}

void collect_settings(Bytes items, GpmfSettings& settings, int depth) {
  if (depth > kMaxDepth) return;
  for_each_item(items, [&](const GpmfItem& item) {
    if (item.type == 0) collect_settings(item.data, settings, depth + 1);
    if (item.key == "VFOV") settings.field_of_view = text_of(item);
    if (item.key == "ZFOV") settings.diagonal_deg = first_number(item);
    if (item.key == "MINF") settings.device = text_of(item);
  });
}

}  // namespace

void for_each_item(Bytes items, const std::function<void(const GpmfItem&)>& visit) {
  ByteReader in(items);
  while (in.left() >= 8) {
    GpmfItem item{.key = in.fourcc(), .type = static_cast<char>(in.u8()), .data = {}};
    item.element_size = in.u8();
    item.count = in.u16();
    const std::size_t length = item.element_size * item.count;
    item.data = in.take(length);
    if (!in.ok() || item.key[0] == '\0') return;  // zeros fill the end of some payloads
    visit(item);
    in.skip(std::min(in.left(), (4 - length % 4) % 4));
  }
}

std::vector<double> numbers_of(const GpmfItem& item) {
  std::vector<double> numbers;
  const std::size_t bytes = number_size(item.type);
  if (bytes == 0) return numbers;
  ByteReader in(item.data);
  numbers.reserve(item.data.size() / bytes);
  while (in.left() >= bytes) numbers.push_back(read_number(in, item.type));
  return numbers;
}

std::string text_of(const GpmfItem& item) {
  std::string text;
  if (item.type == 'c') text.assign(item.data.begin(), item.data.end());
  return text.substr(0, text.find('\0'));
}

const GpmfStream* GpmfPayload::find(const std::string& key) const {
  const auto it = std::find_if(streams.begin(), streams.end(),
                               [&](const GpmfStream& s) { return s.key == key; });
  return it == streams.end() ? nullptr : &*it;
}

GpmfPayload parse_gpmf(Bytes payload) {
  GpmfPayload out;
  for_each_item(payload, [&](const GpmfItem& item) {
    if (item.key == "DEVC" && item.type == 0) parse_device(item.data, out);
  });
  return out;
}

GpmfSettings parse_gpmf_settings(Bytes items) {
  GpmfSettings settings;
  collect_settings(items, settings, 0);
  return settings;
}

}  // namespace apvi::importer
