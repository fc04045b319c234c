// SPDX-License-Identifier: BSD-3-Clause
#include "viewer/export_page.hpp"

#include <algorithm>
#include <bit>
#include <cmath>
#include <nlohmann/json.hpp>
#include <string_view>

#include "viewer/message.hpp"
#include "viewer/page.hpp"

namespace apvi::viewer {
namespace {

using Json = nlohmann::json;

constexpr float kColorRange = 4.0F;

template <typename T>
void append(std::string& out, T value) {
  const auto bytes = std::bit_cast<std::array<char, sizeof(T)>>(value);
  out.append(bytes.data(), bytes.size());
}

// 0 to 1 in 16 bits.
std::uint16_t fraction(float x) {
  return static_cast<std::uint16_t>(std::lround(std::clamp(x, 0.0F, 1.0F) * 65535.0F));
}

std::string packed(const std::vector<Splat>& splats) {
  std::string out;
  for (const Splat& s : splats) {
    for (const float x : s.mean) append(out, x);
    for (const float x : s.sigmas) append(out, x);
    for (const float q : s.quaternion) {
      append(out, static_cast<std::uint8_t>(std::lround(128.0F + 127.0F * q)));
    }
    for (const float c : s.color) append(out, fraction(c / kColorRange));
    append(out, fraction(s.opacity));
  }
  return out;
}

// RFC 4648, with padding.
std::string base64(std::string_view bytes) {
  constexpr std::string_view kDigits =
      "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  std::string out;
  out.reserve((bytes.size() + 2) / 3 * 4);
  for (std::size_t i = 0; i < bytes.size(); i += 3) {
    std::uint32_t group = 0;
    for (std::size_t k = 0; k < 3; ++k) {
      const char byte = i + k < bytes.size() ? bytes[i + k] : '\0';
      group = (group << 8U) | static_cast<unsigned char>(byte);
    }
    for (int k = 3; k >= 0; --k) out += kDigits[(group >> static_cast<unsigned>(6 * k)) & 63U];
  }
  const std::size_t padding = (3 - bytes.size() % 3) % 3;
  out.replace(out.size() - padding, padding, padding, '=');
  return out;
}

Json water_json(const StaticMap::Water& water) {
  return {{"beta_d", water.beta_d}, {"beta_b", water.beta_b}, {"b_inf", water.b_inf}};
}

}  // namespace

std::string export_page(const SceneDescription& description, const StaticMap& map) {
  Json scene = Json::parse(scene_message(description));
  scene["gaussians"] = map.splats.size();
  scene["gains"] = map.gains;
  scene["antialiased"] = map.antialiased;
  if (map.water) scene["water"] = water_json(*map.water);
  return static_page(scene.dump(-1, ' ', false, Json::error_handler_t::replace),
                     base64(packed(map.splats)));
}

}  // namespace apvi::viewer
