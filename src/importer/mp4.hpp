// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <filesystem>
#include <iosfwd>
#include <limits>
#include <optional>
#include <string>
#include <vector>

#include "importer/byte_reader.hpp"

/// The index of an MP4 or MOV file (ISO 14496-12): tracks and where their samples are.
namespace apvi::importer {

struct Mp4Sample {
  std::uint64_t offset = 0;  ///< in the file [bytes]
  std::uint32_t size = 0;    ///< [bytes]
  double time_s = 0.0;       ///< presentation time, edit list included [s]
  double duration_s = 0.0;
};

struct Mp4Track {
  std::string handler;             ///< "vide", "soun", "meta"
  std::string format;              ///< of the first sample description: "avc1", "gpmd"
  std::vector<Mp4Sample> samples;  ///< of video and GPMF tracks only
  /// Where the edit list begins to show samples [s]; players decode earlier ones, but hide them.
  double shown_from_s = -std::numeric_limits<double>::infinity();

  /// Presentation time of the first image or payload that is shown [s].
  double first_s() const;
};

struct Mp4Movie {
  std::vector<Mp4Track> tracks;
  std::optional<std::int64_t> created_unix_s;  ///< nothing when the file has no date
  std::vector<std::uint8_t> gpmf;              ///< GoPro's settings in `udta`; often empty

  /// The first track with this handler, or of this format; null if there is none.
  const Mp4Track* with_handler(const std::string& handler) const;
  const Mp4Track* with_format(const std::string& format) const;
};

/// Parses the content of a `moov` box. Throws InputError, beginning with `name`, when its sample
/// tables contradict each other or refer past their end.
Mp4Movie parse_moov(Bytes moov, const std::string& name);

/// Whether the file begins like an MP4 or MOV file.
bool is_mp4(const std::filesystem::path& path);
/// Reads the index of a file. Throws InputError when the file cannot be read or has no index
/// (its recording was interrupted).
Mp4Movie read_mp4(const std::filesystem::path& path);

/// The bytes of one sample. Throws InputError when they lie past the end of the file.
std::vector<std::uint8_t> read_sample(std::istream& file, const Mp4Sample& sample,
                                      const std::string& name);

}  // namespace apvi::importer
