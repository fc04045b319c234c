// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "importer/dive_writer.hpp"
#include "importer/image_encoder.hpp"

namespace apvi::importer {

/// Order of names in which digits count as numbers: "img2" before "img10".
bool natural_less(const std::string& a, const std::string& b);

/// Stamps of names like 1700000000000000000.jpg [ns]; nullopt if one is none or they do not
/// increase.
std::optional<std::vector<Stamp>> stamps_of_names(const std::vector<std::string>& names);
/// Stamps of images without times.
std::vector<Stamp> stamps_a_second_apart(std::size_t count);

/// Adds an image file: its bytes as they are, or decoded and encoded again to change its size.
/// Throws InputError when it cannot be read or decoded.
void add_photo(const std::filesystem::path& file, Stamp stamp, const ImageOptions& options,
               DiveWriter& dive);

/// Adds the mask of the newest image if `masks` has one for the image of that relative path, in the
/// images' size. True if it has. Throws RunError when it cannot be read.
bool add_mask(const std::filesystem::path& masks, const std::filesystem::path& image,
              const ImageOptions& options, DiveWriter& dive);

/// Logs how many of the images have a mask. Throws InputError if none has.
void report_masks(const std::filesystem::path& masks, std::size_t found, std::size_t images);

}  // namespace apvi::importer
