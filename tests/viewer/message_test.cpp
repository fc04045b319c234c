// SPDX-License-Identifier: BSD-3-Clause
#include "viewer/message.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstring>
#include <nlohmann/json.hpp>
#include <random>

#include "core/random.hpp"

namespace apvi::viewer {
namespace {

using Json = nlohmann::json;

Json view_json() {
  return {{"type", "view"},   {"id", 7},        {"width", 640},
          {"height", 480},    {"focal", 0.8},   {"water", 0.5},
          {"layer", "depth"}, {"moving", true}, {"pose", {0.6, 0.8, 0, 0, 1, 2, 3}}};
}

Json section_json() {
  return {{"normal", {0.6, 0.0, -0.8}}, {"offset", -2.5}, {"thickness", 0.25}};
}

bool valid(const Json& json) {
  return parse_message(json.dump()).has_value();
}

TEST(Message, ReadsAView) {
  const auto message = parse_message(view_json().dump());
  ASSERT_TRUE(message);
  const auto& m = std::get<ViewMessage>(*message);
  EXPECT_EQ(m.id, 7U);
  EXPECT_TRUE(m.moving);
  EXPECT_EQ(m.view.layer, Layer::depth);
  EXPECT_EQ(m.view.water, 0.5);
  EXPECT_EQ(m.view.viewpoint.width, 640);
  EXPECT_EQ(m.view.viewpoint.T_world_camera.translation, Eigen::Vector3d(1, 2, 3));
  EXPECT_NEAR(m.view.viewpoint.T_world_camera.rotation.x(), 0.8, 1e-12);
}

TEST(Message, ReadsASection) {
  Json json = view_json();
  json["section"] = section_json();
  const auto message = parse_message(json.dump());
  ASSERT_TRUE(message);
  const auto& section = std::get<ViewMessage>(*message).view.viewpoint.section;
  ASSERT_TRUE(section);
  EXPECT_TRUE(section->normal.isApprox(Eigen::Vector3d(0.6, 0.0, -0.8)));
  EXPECT_EQ(section->offset_m, -2.5);
  EXPECT_EQ(section->thickness_m, 0.25);
  json.update({{"type", "measure"}, {"column", 0}, {"row", 0}});
  EXPECT_TRUE(std::get<MeasureMessage>(*parse_message(json.dump())).viewpoint.section);
}

TEST(Message, WithoutASectionTheWholeMapIsSeen) {
  Json json = view_json();
  EXPECT_FALSE(std::get<ViewMessage>(*parse_message(json.dump())).view.viewpoint.section);
  json["section"] = nullptr;
  EXPECT_FALSE(std::get<ViewMessage>(*parse_message(json.dump())).view.viewpoint.section);
}

TEST(Message, RefusesASectionThatIsNone) {
  const std::vector<std::pair<const char*, Json>> changes = {
      {"normal", {0, 0, 0}},     {"normal", {1, 1, 0}},   {"normal", {1, 0}},
      {"normal", {1, 0, "0"}},   {"normal", {{1, 0, 0}}}, {"normal", 1},
      {"normal", {1e300, 0, 0}}, {"offset", 1e8},         {"offset", nullptr},
      {"offset", "0"},           {"thickness", 0.0},      {"thickness", -1.0},
      {"thickness", 1e8},        {"thickness", true}};
  for (const auto& [key, value] : changes) {
    Json json = view_json();
    json["section"] = section_json();
    json["section"][key] = value;
    EXPECT_FALSE(valid(json)) << json.dump();
  }
  for (const char* key : {"normal", "offset", "thickness"}) {
    Json json = view_json();
    json["section"] = section_json();
    json["section"].erase(key);
    EXPECT_FALSE(valid(json)) << key;
  }
  for (const Json& section : {Json(3), Json("z"), Json::array({1, 2, 3}), Json(false)}) {
    Json json = view_json();
    json["section"] = section;
    EXPECT_FALSE(valid(json)) << json.dump();
  }
}

TEST(Message, ReadsEveryType) {
  Json snapshot = view_json();
  snapshot["type"] = "snapshot";
  EXPECT_TRUE(std::holds_alternative<SnapshotMessage>(*parse_message(snapshot.dump())));
  Json measure = view_json();
  measure.update({{"type", "measure"}, {"column", 639}, {"row", 0}});
  EXPECT_EQ(std::get<MeasureMessage>(*parse_message(measure.dump())).column, 639);
  EXPECT_EQ(std::get<DrawnMessage>(*parse_message(R"({"type":"drawn","frame":4294967295})")).frame,
            4294967295U);
  EXPECT_TRUE(std::holds_alternative<SaveMessage>(*parse_message(R"({"type":"save"})")));
  EXPECT_TRUE(std::get<PauseMessage>(*parse_message(R"({"type":"pause","paused":true})")).paused);
}

TEST(Message, RefusesValuesOutOfRange) {
  const std::vector<std::pair<const char*, Json>> changes = {{"id", -1},
                                                             {"id", 4294967296},
                                                             {"width", 0},
                                                             {"width", 4097},
                                                             {"width", 1e300},
                                                             {"width", 640.5},
                                                             {"height", -480},
                                                             {"focal", 0.0},
                                                             {"focal", nullptr},
                                                             {"water", 2.1},
                                                             {"water", "1"},
                                                             {"layer", "normal"},
                                                             {"layer", 3},
                                                             {"moving", 1},
                                                             {"pose", {1, 0, 0, 0, 0, 0}},
                                                             {"pose", {2, 0, 0, 0, 0, 0, 0}},
                                                             {"pose", {0, 0, 0, 0, 0, 0, 0}},
                                                             {"pose", {1, 0, 0, 0, 1e8, 0, 0}},
                                                             {"pose", {1, 0, 0, 0, "0", 0, 0}},
                                                             {"type", "views"},
                                                             {"type", nullptr}};
  for (const auto& [key, value] : changes) {
    Json json = view_json();
    json[key] = value;
    EXPECT_FALSE(valid(json)) << json.dump();
  }
}

TEST(Message, RefusesMissingFields) {
  const Json whole = view_json();
  for (auto field = whole.begin(); field != whole.end(); ++field) {
    Json json = whole;
    json.erase(field.key());
    EXPECT_FALSE(valid(json)) << field.key();
  }
}

TEST(Message, RefusesImagesThatAreTooLarge) {
  Json json = view_json();
  json.update({{"width", 4096}, {"height", 4096}});
  EXPECT_FALSE(valid(json));
  json.update({{"width", 3840}, {"height", 2160}});
  EXPECT_TRUE(valid(json));
}

TEST(Message, RefusesAPixelOutsideTheImage) {
  Json json = view_json();
  json.update({{"type", "measure"}, {"column", 640}, {"row", 0}});
  EXPECT_FALSE(valid(json));
}

TEST(Message, RefusesWhatIsNoObject) {
  for (const char* text :
       {"", "null", "[]", "3", "\"view\"", "{", "{}", "\xff\xfe", "{\"type\":}"}) {
    EXPECT_FALSE(parse_message(text)) << text;
  }
  EXPECT_FALSE(parse_message(std::string(10000, '[')));
  EXPECT_FALSE(parse_message(std::string(kMaxMessage + 1, ' ')));
}

TEST(Message, SurvivesDamagedText) {
  Json json = view_json();
  json["section"] = section_json();
  const std::string text = json.dump();
  Random random(5);
  int good = 0;
  for (int i = 0; i < 20000; ++i) {
    std::string damaged = text;
    for (int k = 0; k < 3; ++k) {
      const auto place =
          static_cast<std::size_t>(random.uniform() * static_cast<double>(text.size()));
      damaged[place] = static_cast<char>(random.uniform() * 256.0);
    }
    good += parse_message(damaged).has_value() ? 1 : 0;
  }
  EXPECT_LT(good, 10000);
}

TEST(Message, ImagesHaveAHeaderOf24Bytes) {
  const std::string data = with_header({.kind = ImageKind::snapshot,
                                        .layer = Layer::depth,
                                        .complete = false,
                                        .id = 0x01020304,
                                        .view = 5,
                                        .width = 640,
                                        .height = 480,
                                        .near_m = 1.5F,
                                        .far_m = 9.0F},
                                       "JPEG");
  ASSERT_EQ(data.size(), 28U);
  EXPECT_EQ(data.substr(0, 12),
            std::string("\x02\x02\x00\x00\x04\x03\x02\x01\x05\x00\x00\x00", 12));
  float near_m = 0.0F;
  std::memcpy(&near_m, data.data() + 16, 4);
  EXPECT_EQ(near_m, 1.5F);
  EXPECT_EQ(data.substr(24), "JPEG");
}

TEST(Message, APointOrItsAbsenceIsAnswered) {
  const Json point = Json::parse(point_message(3, Eigen::Vector3d(1, 2, 3), 4.5));
  EXPECT_EQ(point,
            Json({{"type", "point"}, {"id", 3}, {"point", {1.0, 2.0, 3.0}}, {"range_m", 4.5}}));
  EXPECT_TRUE(Json::parse(point_message(3, std::nullopt, 0.0)).at("point").is_null());
}

TEST(Message, LongTrajectoriesAreThinnedAndKeepTheirEnd) {
  SceneDescription d;
  for (int i = 0; i < 50001; ++i) {
    StampedPose pose;
    pose.stamp.ns = 1000000000LL * i;
    d.trace.push_back({pose, i == 50000 ? "frozen" : "fused"});
  }
  const Json scene = Json::parse(scene_message(d));
  EXPECT_LE(scene.at("poses").size(), 20001U);
  EXPECT_EQ(scene.at("poses").size(), scene.at("stamps").size());
  EXPECT_EQ(scene.at("states").back(), "frozen");
  EXPECT_EQ(scene.at("stamps").back(), 50000.0);
}

Stamp at_s(double seconds) {
  return Stamp{} + Duration::from_seconds(seconds);
}

TEST(Message, TheSceneHasLoopsBeamsAndSensors) {
  SceneDescription d;
  EXPECT_TRUE(Json::parse(scene_message(d)).at("beams").is_null());
  d.loops = {{at_s(1.5), at_s(9.0)}};
  d.sensors = {{"imu", {{at_s(0.0), at_s(4.0)}, {at_s(5.0), at_s(9.0)}}}};
  d.beams.emplace();
  d.beams->directions.fill(Eigen::Vector3d::UnitZ());
  d.beams->pings = {{.stamp = at_s(2.0),
                     .length_m = {1.0, 2.0, 3.00049, 4.0},
                     .valid = {true, false, false, true},
                     .measured = {false, true, false, false}}};
  const Json scene = Json::parse(scene_message(d));
  EXPECT_EQ(scene.at("loops"), Json::parse("[[1.5, 9.0]]"));
  EXPECT_EQ(scene.at("sensors"),
            Json::parse(R"([{"name": "imu", "spans": [[0.0, 4.0], [5.0, 9.0]]}])"));
  const Json& beams = scene.at("beams");
  EXPECT_EQ(beams.at("directions").size(), 4U);
  EXPECT_EQ(beams.at("lengths"), Json::parse("[[1.0, 2.0, 3.0, 4.0]]"));
  EXPECT_EQ(beams.at("valid"), Json::parse("[9]"));
  EXPECT_EQ(beams.at("measured"), Json::parse("[2]"));
  EXPECT_EQ(Json::parse(beams_message(*d.beams)).at("beams"), beams);
  const Json pings = Json::parse(pings_message(d.beams->pings));
  EXPECT_EQ(pings.at("type"), "pings");
  EXPECT_EQ(pings.at("stamps"), beams.at("stamps"));
  EXPECT_EQ(Json::parse(loops_message(d.loops)).at("loops"), scene.at("loops"));
  EXPECT_EQ(Json::parse(sensors_message(d.sensors)).at("sensors"), scene.at("sensors"));
}

TEST(Message, ASaveIsAnswered) {
  EXPECT_EQ(Json::parse(saved_message("")), Json({{"type", "saved"}, {"error", ""}}));
  EXPECT_EQ(Json::parse(saved_message("disk full\xff")).at("type"), "saved");
}

TEST(Message, NamesThatAreNoUtf8DoNotBreakTheScene) {
  SceneDescription d;
  d.name = "dive\xff";
  EXPECT_THAT(scene_message(d), testing::HasSubstr("dive"));
}

}  // namespace
}  // namespace apvi::viewer
