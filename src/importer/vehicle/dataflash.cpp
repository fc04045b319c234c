// SPDX-License-Identifier: BSD-3-Clause
#include "importer/vehicle/dataflash.hpp"

#include <algorithm>
#include <array>
#include <map>
#include <utility>

#include "core/text.hpp"
#include "importer/vehicle/byte_window.hpp"

namespace apvi::importer {
namespace {

constexpr std::array<std::uint8_t, 2> kMagic = {0xA3, 0x95};
constexpr std::size_t kHeader = 3;
constexpr std::uint8_t kFormatType = 128;
constexpr std::size_t kFormatSize = 89;
constexpr std::size_t kMaxMessage = 255;

// Size of a field, and the factor of its number; 0 for text.
struct Type {
  std::size_t size = 0;
  double factor = 0.0;
};
const std::map<char, Type>& types() {
  static const std::map<char, Type> known = {
      {'b', {1, 1.0}},  {'B', {1, 1.0}},  {'M', {1, 1.0}},  {'h', {2, 1.0}},  {'H', {2, 1.0}},
      {'g', {2, 0.0}},  {'c', {2, 0.01}}, {'C', {2, 0.01}}, {'i', {4, 1.0}},  {'I', {4, 1.0}},
      {'e', {4, 0.01}}, {'E', {4, 0.01}}, {'L', {4, 1e-7}}, {'f', {4, 1.0}},  {'d', {8, 1.0}},
      {'q', {8, 1.0}},  {'Q', {8, 1.0}},  {'n', {4, 0.0}},  {'N', {16, 0.0}}, {'Z', {64, 0.0}},
      {'a', {64, 0.0}}};
  return known;
}

double raw_number(Bytes bytes, char type) {
  ByteReader reader(bytes, ByteOrder::little);
  switch (type) {
    case 'f':
      return reader.f32();
    case 'd':
      return reader.f64();
    case 'b':
      return static_cast<std::int8_t>(reader.u8());
    case 'B':
    case 'M':
      return reader.u8();
    case 'h':
    case 'c':
      return static_cast<std::int16_t>(reader.u16());
    case 'H':
    case 'C':
      return reader.u16();
    case 'i':
    case 'e':
    case 'L':
      return reader.i32();
    case 'I':
    case 'E':
      return reader.u32();
    case 'q':
      return static_cast<double>(reader.i64());
    default:
      return static_cast<double>(reader.u64());
  }
}

std::string trimmed(std::string text) {
  text.resize(std::min(text.find('\0'), text.size()));
  return text;
}

// Fields of type letters and names; empty unless they fill the message.
std::vector<DataflashField> fields_of(const std::string& letters, const std::string& columns,
                                      std::size_t size) {
  std::vector<std::string_view> names;
  text::split(columns, ',', names);
  if (names.size() != letters.size()) return {};
  std::vector<DataflashField> fields;
  std::size_t offset = kHeader;
  for (std::size_t i = 0; i < letters.size(); ++i) {
    const auto type = types().find(letters[i]);
    if (type == types().end()) return {};
    fields.push_back({std::string(names[i]), letters[i], offset});
    offset += type->second.size;
  }
  return offset == size ? fields : std::vector<DataflashField>{};
}

class Parser {
 public:
  explicit Parser(std::istream& in) : window_(in) {
    formats_[kFormatType] = {.name = "FMT", .size = kFormatSize, .fields = {}};
  }

  std::size_t run(const std::function<void(const DataflashMessage&)>& visit) {
    std::size_t skipped = 0;
    std::size_t pending = 0;  // skipped since the last message
    while (true) {
      const Bytes bytes = window_.ahead(kMaxMessage + kMagic.size());
      if (bytes.size() < kHeader) return skipped;
      const std::size_t size = message_size(bytes);
      if (size == 0) {
        window_.skip(1);
        ++pending;
        continue;
      }
      skipped += std::exchange(pending, 0);
      take(bytes.first(size), visit);
      window_.skip(size);
    }
  }

 private:
  // 0 unless a message begins here and another one, or the end, follows it: without checksums that
  // is what shows that it is whole.
  std::size_t message_size(Bytes bytes) const {
    if (!begins_message(bytes)) return 0;
    const std::size_t size = formats_[bytes[2]].size;
    if (size == 0 || size > bytes.size()) return 0;
    const Bytes after = bytes.subspan(size);
    return after.size() < kMagic.size() || begins_message(after) ? size : 0;
  }
  static bool begins_message(Bytes bytes) { return bytes[0] == kMagic[0] && bytes[1] == kMagic[1]; }

  void take(Bytes bytes, const std::function<void(const DataflashMessage&)>& visit) {
    if (bytes[2] == kFormatType) return add_format(bytes.subspan(kHeader));
    const DataflashFormat& format = formats_[bytes[2]];
    if (!format.fields.empty()) visit(DataflashMessage(format, bytes));
  }

  void add_format(Bytes bytes) {
    ByteReader reader(bytes, ByteOrder::little);
    const std::uint8_t type = reader.u8();
    const std::size_t size = reader.u8();
    const std::string name = trimmed(reader.text(4));
    const std::string letters = trimmed(reader.text(16));
    const std::string columns = trimmed(reader.text(64));
    if (type == kFormatType || size < kHeader) return;
    formats_[type] = {.name = name, .size = size, .fields = fields_of(letters, columns, size)};
  }

  ByteWindow window_;
  std::array<DataflashFormat, 256> formats_;
};

}  // namespace

const DataflashField* DataflashMessage::find(std::string_view field) const {
  const auto found = std::ranges::find(format_.fields, field, &DataflashField::name);
  return found == format_.fields.end() ? nullptr : &*found;
}

std::optional<double> DataflashMessage::number(std::string_view field) const {
  const DataflashField* found = find(field);
  if (found == nullptr) return std::nullopt;
  const Type type = types().at(found->type);
  if (type.factor == 0.0) return std::nullopt;
  return type.factor * raw_number(bytes_.subspan(found->offset, type.size), found->type);
}

std::string DataflashMessage::text(std::string_view field) const {
  const DataflashField* found = find(field);
  if (found == nullptr) return "";
  const Type type = types().at(found->type);
  if (type.factor != 0.0) return "";
  const Bytes bytes = bytes_.subspan(found->offset, type.size);
  return trimmed({bytes.begin(), bytes.end()});
}

bool is_dataflash(Bytes begin) {
  return begin.size() > 2 && begin[0] == kMagic[0] && begin[1] == kMagic[1] &&
         begin[2] == kFormatType;
}

std::size_t for_each_dataflash_message(std::istream& in,
                                       const std::function<void(const DataflashMessage&)>& visit) {
  return Parser(in).run(visit);
}

}  // namespace apvi::importer
