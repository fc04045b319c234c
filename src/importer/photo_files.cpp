// SPDX-License-Identifier: BSD-3-Clause
#include "importer/photo_files.hpp"

#include <cctype>
#include <fstream>
#include <iterator>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <optional>

#include "apvi/core/error.hpp"
#include "apvi/core/log.hpp"
#include "core/text.hpp"
#include "io/folder/csv_file.hpp"
#include "sensors/camera_mask.hpp"

namespace apvi::importer {
namespace {

std::vector<std::uint8_t> read_all(const std::filesystem::path& file) {
  std::ifstream in(file, std::ios::binary);
  std::vector<std::uint8_t> bytes{std::istreambuf_iterator<char>(in), {}};
  if (!in || bytes.empty()) fail_input("{}: cannot be read", file.string());
  return bytes;
}

cv::Mat decode(const std::vector<std::uint8_t>& bytes, const std::filesystem::path& file) {
  cv::Mat image;
  try {
    image = cv::imdecode(bytes, cv::IMREAD_ANYCOLOR | cv::IMREAD_IGNORE_ORIENTATION);
  } catch (const cv::Exception&) {  // reported below
  }
  if (image.empty()) fail_input("{}: cannot be decoded; remove it", file.string());
  return image;
}

}  // namespace

// Digits count as numbers: "img2" before "img10".
bool natural_less(const std::string& a, const std::string& b) {
  const auto digit = [](char c) { return std::isdigit(static_cast<unsigned char>(c)) != 0; };
  std::size_t i = 0;
  std::size_t k = 0;
  while (i < a.size() && k < b.size()) {
    if (!digit(a[i]) || !digit(b[k])) {
      if (a[i] != b[k]) return a[i] < b[k];
      ++i;
      ++k;
      continue;
    }
    const auto number = [&](const std::string& s, std::size_t& at) {
      while (at < s.size() && s[at] == '0') ++at;
      const std::size_t from = at;
      while (at < s.size() && digit(s[at])) ++at;
      return s.substr(from, at - from);
    };
    const std::string x = number(a, i);
    const std::string y = number(b, k);
    if (x.size() != y.size()) return x.size() < y.size();
    if (x != y) return x < y;
  }
  if (i < a.size() || k < b.size()) return k < b.size();
  return a < b;  // "01" and "1"
}

std::optional<std::vector<Stamp>> stamps_of_names(const std::vector<std::string>& names) {
  constexpr std::size_t kDigits = 16;  // fewer are numbers of images
  std::vector<Stamp> stamps;
  for (const std::string& name : names) {
    const std::string stem = std::filesystem::path(name).stem().string();
    const auto ns = text::parse_int64(stem);
    const bool plausible = ns && *ns >= 0 && *ns <= io::kMaxStampNs && stem.size() >= kDigits;
    if (!plausible || (!stamps.empty() && *ns <= stamps.back().ns)) return std::nullopt;
    stamps.push_back(Stamp{*ns});
  }
  return stamps;
}

std::vector<Stamp> stamps_a_second_apart(std::size_t count) {
  std::vector<Stamp> stamps;
  for (std::size_t i = 0; i < count; ++i) {
    stamps.push_back(kWithoutDate + Duration{static_cast<std::int64_t>(i) * 1'000'000'000});
  }
  return stamps;
}

void add_photo(const std::filesystem::path& file, Stamp stamp, const ImageOptions& options,
               DiveWriter& dive) {
  const std::vector<std::uint8_t> bytes = read_all(file);
  if (options.scale == 1.0 && !options.png) {
    return dive.add_image(stamp, text::to_lower(file.extension().string()), bytes);
  }
  dive.add_image(stamp, options.extension(), encode(decode(bytes, file), options));
}

bool add_mask(const std::filesystem::path& masks, const std::filesystem::path& image,
              const ImageOptions& options, DiveWriter& dive) {
  const auto file = masks.empty() ? std::nullopt : find_mask(masks, image);
  if (!file) return false;
  const cv::Mat mask = read_mask(*file);
  const ImageSize size = scaled(ImageSize{mask.cols, mask.rows}, options.scale);
  cv::Mat small;
  cv::resize(mask, small, {size.width, size.height}, 0.0, 0.0, cv::INTER_AREA);
  dive.add_mask(encode(small == 255, {.png = true}));
  return true;
}

void report_masks(const std::filesystem::path& masks, std::size_t found, std::size_t images) {
  if (masks.empty()) return;
  if (found == 0) {
    fail_input("{}: no mask of any image; they are named as the images, as .png", masks.string());
  }
  log::info("masks of {} of {} images", found, images);
}

}  // namespace apvi::importer
