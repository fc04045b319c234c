# SPDX-License-Identifier: BSD-3-Clause
# cmake -DFILES=a;b -DOUTPUT=file.cpp -P EmbedFiles.cmake: a source file that defines the contents of files, as
# src/viewer/page.hpp declares them.
set(text "// Made by scripts/cmake/EmbedFiles.cmake.\n#include \"viewer/page_files.hpp\"\n\nnamespace apvi::viewer {\nnamespace {\n\n")
set(table "")
set(number 0)
foreach(file IN LISTS FILES)
  get_filename_component(name ${file} NAME)
  file(READ ${file} bytes HEX)
  string(LENGTH "${bytes}" digits)
  math(EXPR size "${digits} / 2")
  string(REGEX REPLACE "([0-9a-f][0-9a-f])" "0x\\1," bytes "${bytes}")
  string(APPEND text "constexpr unsigned char kFile${number}[] = {${bytes}};\n")
  string(APPEND table "  if (name == \"${name}\") return {reinterpret_cast<const char*>(kFile${number}), ${size}};\n")
  math(EXPR number "${number} + 1")
endforeach()
string(APPEND text "\n}  // namespace\n\nstd::string_view page_file(std::string_view name) {\n${table}  return {};\n}\n\n}  // namespace apvi::viewer\n")
file(WRITE ${OUTPUT} "${text}")
