// SPDX-License-Identifier: BSD-3-Clause
#include "viewer/page.hpp"

#include <initializer_list>

#include "viewer/page_files.hpp"

namespace apvi::viewer {
namespace {

void replace(std::string& text, std::string_view mark, std::string_view content) {
  const std::size_t place = text.find(mark);
  if (place != std::string::npos) text.replace(place, mark.size(), content);
}

std::string scripts(std::initializer_list<std::string_view> names) {
  std::string text;
  for (const std::string_view name : names) text.append(page_file(name)).append("\n");
  return text;
}

std::string page(std::string_view data, std::string_view script) {
  std::string text(page_file("index.html"));
  replace(text, "/* style */", page_file("viewer.css"));
  replace(text, "<!-- data -->", data);
  replace(text, "/* script */", script);
  return text;
}

// Within an element <script>, "</" would end it.
std::string escaped(std::string_view json) {
  std::string text;
  for (const char c : json) text += c == '<' ? std::string("\\u003c") : std::string(1, c);
  return text;
}

}  // namespace

std::string live_page() {
  return page("", scripts({"math.js", "overlay.js", "dive.js", "controls.js", "link.js", "panel.js",
                           "measure.js", "section.js", "live.js", "viewer.js"}));
}

std::string static_page(std::string_view scene, std::string_view splats) {
  std::string data = "<script type=\"application/json\" id=\"scene-data\">" + escaped(scene);
  data += "</script>\n<script type=\"text/plain\" id=\"splat-data\">";
  data.append(splats).append("</script>");
  return page(data, scripts({"math.js", "overlay.js", "dive.js", "controls.js", "splats.js",
                             "panel.js", "measure.js", "section.js", "live.js", "viewer.js"}));
}

}  // namespace apvi::viewer
