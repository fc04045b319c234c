// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <cmath>
#include <istream>

#include "apvi/core/error.hpp"
#include "core/text.hpp"
#include "importer/colmap_model.hpp"
#include "importer/colmap_numbers.hpp"

namespace apvi::importer {
namespace {

/// Lines that are not comments, split at white space.
class Lines {
 public:
  Lines(std::istream& in, std::string name) : in_(in), name_(std::move(name)) {}

  bool next() {
    while (next_raw()) {
      if (!words_.empty() && words_[0].front() != '#') return true;
    }
    return false;
  }
  // The next line, whatever it holds.
  bool next_raw() {
    if (!std::getline(in_, line_)) return false;
    ++number_;
    words_.clear();
    const std::string_view text = line_;
    for (std::size_t at = 0; (at = text.find_first_not_of(" \t\r", at)) != text.npos;) {
      const std::size_t end = std::min(text.find_first_of(" \t\r", at), text.size());
      words_.push_back(text.substr(at, end - at));
      at = end;
    }
    return true;
  }
  std::size_t size() const { return words_.size(); }
  std::string word(std::size_t i) const { return std::string(words_[i]); }
  // From a word to the end of the line: names may contain spaces.
  std::string rest(std::size_t i) const {
    return std::string(text::trim(
        std::string_view(line_).substr(static_cast<std::size_t>(words_[i].data() - line_.data()))));
  }
  void require(std::size_t count, const char* expected) const {
    if (words_.size() < count) fail_input("{}:{}: expected {}", name_, number_, expected);
  }
  double number(std::size_t i) const {
    const auto value = text::parse_double(words_[i]);
    if (!value || !std::isfinite(*value)) {
      fail_input("{}:{}: \"{:.40}\" is not a number", name_, number_, words_[i]);
    }
    return *value;
  }
  std::uint32_t id(std::size_t i) const {
    const auto value = text::parse_int64(words_[i]);
    if (!value || *value < 0 || *value > 0xFFFFFFFFLL) {
      fail_input("{}:{}: \"{:.40}\" is not an id", name_, number_, words_[i]);
    }
    return static_cast<std::uint32_t>(*value);
  }
  std::string where() const { return fmt::format("{}:{}", name_, number_); }

 private:
  std::istream& in_;
  std::string name_;
  std::string line_;
  std::vector<std::string_view> words_;
  std::size_t number_ = 0;
};

}  // namespace

std::map<std::uint32_t, ColmapCamera> parse_cameras_txt(std::istream& in, const std::string& name) {
  std::map<std::uint32_t, ColmapCamera> cameras;
  for (Lines line(in, name); line.next();) {
    line.require(5, "CAMERA_ID MODEL WIDTH HEIGHT PARAMS");
    ColmapCamera camera{
        .model = line.word(1), .width = line.id(2), .height = line.id(3), .parameters = {}};
    for (std::size_t i = 4; i < line.size(); ++i) camera.parameters.push_back(line.number(i));
    cameras[line.id(0)] = camera;
  }
  return cameras;
}

std::vector<ColmapImage> parse_images_txt(std::istream& in, const std::string& name) {
  std::vector<ColmapImage> images;
  for (Lines line(in, name); line.next();) {
    line.require(10, "IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME");
    std::array<double, 7> pose{};
    for (std::size_t i = 0; i < 7; ++i) pose[i] = line.number(i + 1);
    images.push_back({.name = line.rest(9),
                      .camera = line.id(8),
                      .T_camera_world = to_pose(pose, line.where())});
    line.next_raw();  // points of the image; may be empty
  }
  return images;
}

std::vector<ColmapPoint> parse_points_txt(std::istream& in, const std::string& name) {
  std::vector<ColmapPoint> points;
  for (Lines line(in, name); line.next();) {
    line.require(7, "POINT3D_ID X Y Z R G B");
    ColmapPoint point{.position = {line.number(1), line.number(2), line.number(3)}};
    for (std::size_t i = 0; i < 3; ++i) {
      point.color[i] = static_cast<int>(std::min(255U, line.id(4 + i)));
    }
    points.push_back(point);
  }
  return points;
}

}  // namespace apvi::importer
