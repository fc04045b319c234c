// SPDX-License-Identifier: BSD-3-Clause
#include <sstream>

#include "apvi/core/error.hpp"
#include "fuzz/fuzz_target.hpp"
#include "importer/colmap_model.hpp"

// One file of a COLMAP model, read as each of the six kinds.

namespace {

template <typename F>
void tolerate_input_error(F&& f) {
  try {
    f();
  } catch (const apvi::InputError&) {
  }
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace apvi;
  const importer::Bytes bytes(data, size);
  const std::string text(reinterpret_cast<const char*>(data), size);
  const auto stream = [&text] { return std::istringstream(text); };
  const auto use = [](const auto& cameras) {
    for (const auto& entry : cameras) {
      tolerate_input_error([&] { importer::to_camera(entry.second, "fuzz"); });
    }
  };
  tolerate_input_error([&] { use(importer::parse_cameras_bin(bytes, "fuzz")); });
  tolerate_input_error([&] { importer::parse_images_bin(bytes, "fuzz"); });
  tolerate_input_error([&] { importer::parse_points_bin(bytes, "fuzz"); });
  auto in = stream();
  tolerate_input_error([&] { use(importer::parse_cameras_txt(in, "fuzz")); });
  in = stream();
  tolerate_input_error([&] { importer::parse_images_txt(in, "fuzz"); });
  in = stream();
  tolerate_input_error([&] { importer::parse_points_txt(in, "fuzz"); });
  return 0;
}
