// SPDX-License-Identifier: BSD-3-Clause
#include "importer/metashape_model.hpp"

#include <tinyxml2.h>

#include <Eigen/LU>
#include <Eigen/SVD>
#include <algorithm>
#include <cmath>
#include <map>

#include "apvi/core/error.hpp"
#include "apvi/core/log.hpp"
#include "apvi/sensors/lens.hpp"
#include "core/text.hpp"

namespace apvi::importer {
namespace {

using tinyxml2::XMLElement;

std::string attribute(const XMLElement& element, const char* name) {
  const char* value = element.Attribute(name);
  return value == nullptr ? "" : value;
}

// The number in the child of that name; 0 without one.
double number_in(const XMLElement& parent, const char* child, const std::string& name) {
  const XMLElement* element = parent.FirstChildElement(child);
  if (element == nullptr) return 0.0;
  const char* content = element->GetText();
  const auto number = content == nullptr ? std::nullopt : text::parse_double(content);
  if (!number || !std::isfinite(*number)) {
    fail_input("{}:{}: <{}> is not a number", name, element->GetLineNum(), child);
  }
  return *number;
}

std::vector<double> numbers_of(const XMLElement& element, std::size_t count,
                               const std::string& name) {
  std::vector<std::string_view> words;
  const char* content = element.GetText();
  std::string spaced = content == nullptr ? "" : content;
  std::ranges::replace_if(
      spaced, [](char c) { return c == '\n' || c == '\t' || c == '\r'; }, ' ');
  text::split(spaced, ' ', words);
  std::vector<double> numbers;
  for (const std::string_view word : words) {
    if (word.empty()) continue;
    const auto number = text::parse_double(word);
    if (number && std::isfinite(*number)) numbers.push_back(*number);
  }
  if (numbers.size() == count) return numbers;
  fail_input("{}:{}: <{}> does not have {} numbers", name, element.GetLineNum(), element.Name(),
             count);
}

SE3 pose_of(const XMLElement& transform, const std::string& name) {
  const std::vector<double> m = numbers_of(transform, 16, name);
  const Eigen::Map<const Eigen::Matrix<double, 4, 4, Eigen::RowMajor>> T(m.data());
  const Eigen::Matrix3d R = T.topLeftCorner<3, 3>();
  if (!((R * R.transpose() - Eigen::Matrix3d::Identity()).norm() < 1e-3) || R.determinant() < 0.0) {
    fail_input("{}:{}: <transform> is not a rotation and a translation", name,
               transform.GetLineNum());
  }
  return {Eigen::Quaterniond(R).normalized(), T.topRightCorner<3, 1>()};
}

// The adjusted calibration, else the initial one.
const XMLElement* calibration_of(const XMLElement& sensor) {
  const XMLElement* found = nullptr;
  for (const XMLElement* c = sensor.FirstChildElement("calibration"); c != nullptr;
       c = c->NextSiblingElement("calibration")) {
    if (found == nullptr || attribute(*c, "class") == "adjusted") found = c;
  }
  return found;
}

void set_lens(const XMLElement& calibration, const std::string& type, const std::string& name,
              CameraModel::Parameters& p) {
  const auto number = [&](const char* child) { return number_in(calibration, child, name); };
  const auto refuse = [&](const char* what) {
    fail_input("{}:{}: {} cannot be expressed; fit the cameras in Metashape without it", name,
               calibration.GetLineNum(), what);
  };
  const double p1 = number("p1");
  const double p2 = number("p2");
  if (number("b2") != 0.0) refuse("skew (b2)");
  if (number("p3") != 0.0 || number("p4") != 0.0) refuse("tangential distortion (p3, p4)");
  if (type == "fisheye" || type == "equidistant_fisheye") {
    if (p1 != 0.0 || p2 != 0.0) refuse("tangential distortion of a fisheye lens (p1, p2)");
    p.distortion = Distortion::equidistant;
    p.coefficients = {number("k1"), number("k2"), number("k3"), number("k4")};
    return;
  }
  if (type != "frame") refuse(("a camera of type " + type).c_str());
  if (number("k4") != 0.0) refuse("radial distortion of the eighth order (k4)");
  p.coefficients = {number("k1"), number("k2"), p2, p1, number("k3")};
  const bool is_distorted =
      std::ranges::any_of(p.coefficients, [](double value) { return value != 0.0; });
  p.distortion = is_distorted ? Distortion::radtan : Distortion::none;
}

CameraModel::Parameters camera_of(const XMLElement& sensor, const std::string& name) {
  const XMLElement* calibration = calibration_of(sensor);
  if (calibration == nullptr) {
    fail_input("{}:{}: a sensor without calibration; align the images first", name,
               sensor.GetLineNum());
  }
  const XMLElement* resolution = calibration->FirstChildElement("resolution");
  if (resolution == nullptr) resolution = sensor.FirstChildElement("resolution");
  CameraModel::Parameters p;
  if (resolution != nullptr) {
    p.width = resolution->IntAttribute("width");
    p.height = resolution->IntAttribute("height");
  }
  const double f = number_in(*calibration, "f", name);
  p.fx = f + number_in(*calibration, "b1", name);
  p.fy = f;
  constexpr int kMaxSide = 100'000;
  if (p.width <= 0 || p.height <= 0 || p.width > kMaxSide || p.height > kMaxSide ||
      !(p.fx > 0.0 && p.fy > 0.0)) {
    fail_input("{}:{}: a camera of {} x {} with focal length {}", name, sensor.GetLineNum(),
               p.width, p.height, f);
  }
  // cx, cy are offsets from the middle; there the corner of the first pixel is (0, 0).
  p.cx = 0.5 * p.width + number_in(*calibration, "cx", name) - 0.5;
  p.cy = 0.5 * p.height + number_in(*calibration, "cy", name) - 0.5;
  std::string type = attribute(*calibration, "type");
  if (type.empty()) type = attribute(sensor, "type");
  set_lens(*calibration, type, name, p);
  if (const auto problem = lens_problem(p)) fail_input("{}: {}", name, *problem);
  return p;
}

// Aligned images by their sensor; they may be in groups.
void collect(const XMLElement* parent, const std::string& name,
             std::map<std::string, std::vector<MetashapeImage>>& images) {
  if (parent == nullptr) return;
  for (const XMLElement* child = parent->FirstChildElement(); child != nullptr;
       child = child->NextSiblingElement()) {
    if (std::string_view(child->Name()) == "group") collect(child, name, images);
    const XMLElement* transform = child->FirstChildElement("transform");
    if (std::string_view(child->Name()) != "camera" || transform == nullptr) continue;
    images[attribute(*child, "sensor_id")].push_back(
        {attribute(*child, "label"), pose_of(*transform, name)});
  }
}

// That of the chunk, or of its first component.
std::optional<double> scale_of(const XMLElement& chunk, const std::string& name) {
  const XMLElement* transform = chunk.FirstChildElement("transform");
  const XMLElement* components = chunk.FirstChildElement("components");
  if (transform == nullptr && components != nullptr) {
    const XMLElement* first = components->FirstChildElement("component");
    transform = first == nullptr ? nullptr : first->FirstChildElement("transform");
  }
  if (transform == nullptr) return std::nullopt;
  const double scale = number_in(*transform, "scale", name);
  return scale > 0.0 ? std::optional(scale) : std::nullopt;
}

}  // namespace

bool is_metashape(std::string_view begin) {
  return begin.find("<document") != begin.npos && begin.find("<chunk") != begin.npos;
}

MetashapeModel parse_metashape(const std::string& xml, const std::string& name) {
  tinyxml2::XMLDocument document;
  if (document.Parse(xml.data(), xml.size()) != tinyxml2::XML_SUCCESS) {
    fail_input("{}:{}: damaged XML", name, document.ErrorLineNum());
  }
  const XMLElement* root = document.FirstChildElement("document");
  const XMLElement* chunk = root == nullptr ? nullptr : root->FirstChildElement("chunk");
  if (chunk == nullptr) fail_input("{}: not an export of Metashape's cameras", name);
  std::map<std::string, std::vector<MetashapeImage>> images;
  collect(chunk->FirstChildElement("cameras"), name, images);
  if (images.empty()) fail_input("{}: no image is aligned", name);
  const auto most = std::ranges::max_element(
      images, {}, [](const auto& of_sensor) { return of_sensor.second.size(); });
  MetashapeModel model;
  model.scale = scale_of(*chunk, name);
  for (const auto& [sensor, others] : images) model.of_other_sensors += others.size();
  model.of_other_sensors -= most->second.size();
  model.images = std::move(most->second);
  const XMLElement* sensors = chunk->FirstChildElement("sensors");
  const XMLElement* sensor = sensors == nullptr ? nullptr : sensors->FirstChildElement("sensor");
  while (sensor != nullptr && attribute(*sensor, "id") != most->first) {
    sensor = sensor->NextSiblingElement("sensor");
  }
  if (sensor == nullptr) fail_input("{}: has no sensor {}", name, most->first);
  model.camera = camera_of(*sensor, name);
  return model;
}

}  // namespace apvi::importer
