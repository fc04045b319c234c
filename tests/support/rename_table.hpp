// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <functional>
#include <map>
#include <memory>
#include <string>
#include <string_view>

#include "apvi/config/fields.hpp"
#include "config/renamed_keys.hpp"

namespace apvi::test {

/// Checks a rename table against the keys of `Config`: the new keys exist, the old ones do not, and
/// each old key is read as the new one, with one warning. `load` reads a Config from YAML text.
template <typename Config, typename Load>
void expect_valid_renames(const config::Renames& renames, const Load& load) {
  std::map<std::string, config::FieldDoc, std::less<>> fields;
  const auto defaults = std::make_unique<Config>();  // GCC 12 warns falsely about a temporary
  for (const config::FieldDoc& row : config::document(*defaults)) fields.emplace(row.key, row);
  const auto load_value = [&](std::string_view key, const std::string& value) {
    config::Node node;
    config::set_value(node, key, config::parse_yaml(value, "default"));
    return config::to_yaml(config::to_node(load(config::to_yaml(node))));
  };
  for (const config::RenamedKey& key : renames.keys) {
    EXPECT_FALSE(fields.contains(key.old_key)) << key.old_key;
    if (key.new_key.empty()) continue;
    const auto field = fields.find(key.new_key);
    ASSERT_NE(field, fields.end()) << key.new_key;
    if (field->second.type == "section") continue;
    testing::internal::CaptureStderr();
    const std::string by_old_key = load_value(key.old_key, field->second.default_value);
    const std::string log = testing::internal::GetCapturedStderr();
    EXPECT_THAT(log, testing::HasSubstr(std::string(key.old_key) + " is now " +
                                        std::string(key.new_key) + ";"));
    EXPECT_EQ(log.find(" is now "), log.rfind(" is now ")) << log;
    std::string same = field->second.default_value;
    if (key.convert != nullptr) same = fmt::format("{:.4g}", key.convert(std::stod(same)));
    EXPECT_EQ(by_old_key, load_value(key.new_key, same)) << key.old_key;
  }
  for (const config::RenamedValue& value : renames.values) {
    EXPECT_TRUE(fields.contains(value.key)) << value.key;
  }
}

}  // namespace apvi::test
