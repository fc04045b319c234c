// SPDX-License-Identifier: BSD-3-Clause
#include "apvi/core/error.hpp"
#include "fuzz/fuzz_target.hpp"
#include "importer/metashape_model.hpp"

// Cameras exported by Metashape.

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace apvi;
  const std::string xml(reinterpret_cast<const char*>(data), size);
  try {
    const importer::MetashapeModel model = importer::parse_metashape(xml, "cameras.xml");
    fuzz::check(!model.images.empty(), "a model without images");
    CameraModel(model.camera).project({0.1, 0.2, 1.0});
  } catch (const InputError&) {  // expected
  }
  return 0;
}
