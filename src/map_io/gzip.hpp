// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <zlib.h>

#include <cstddef>
#include <iosfwd>
#include <string>
#include <vector>

namespace apvi::map_io {

/// Output bytes that one compressed byte can give at most.
inline constexpr std::size_t kMaxInflation = 1032;

/// Decompresses a gzip file in memory piece by piece.
class GzipReader {
 public:
  /// `name` is for messages; the bytes must outlive this.
  GzipReader(const std::vector<unsigned char>& bytes, std::string name);
  ~GzipReader();
  GzipReader(const GzipReader&) = delete;
  GzipReader& operator=(const GzipReader&) = delete;

  /// Copies the next `size` bytes. Throws InputError when the data are damaged or end.
  void read(unsigned char* to, std::size_t size);

 private:
  const unsigned char* next_;
  std::size_t left_;
  std::string name_;
  z_stream stream_{};
  bool ended_ = false;
};

/// Writes the bytes as a gzip file.
void write_gzip(std::ostream& out, const std::vector<unsigned char>& bytes);

}  // namespace apvi::map_io
