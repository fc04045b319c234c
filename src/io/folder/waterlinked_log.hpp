// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <filesystem>
#include <istream>
#include <memory>
#include <string>

#include "io/sample_source.hpp"

namespace apvi::io {

/// The velocity reports in a log of Water Linked's JSON protocol (DVL A50, A125 and others), a
/// report in each line. The stamp is `time_of_validity`. Text around a report, such as the stamp of
/// a logger, and reports of other kinds are skipped. Velocities against the water are invalid.
std::unique_ptr<SampleSource> waterlinked_dvl(const std::filesystem::path& path);
/// The same from any stream; `name` is the file name for messages, `size` that of the file, or 0.
std::unique_ptr<SampleSource> waterlinked_dvl(std::unique_ptr<std::istream> in, std::string name,
                                              std::uint64_t size = 0);

}  // namespace apvi::io
