// SPDX-License-Identifier: BSD-3-Clause
#include "map_io/gzip.hpp"

#include <algorithm>
#include <ostream>
#include <utility>
#include <vector>

#include "apvi/core/error.hpp"

namespace apvi::map_io {
namespace {

constexpr int kGzip = 16 + MAX_WBITS;      // zlib's flag for the gzip format
constexpr std::size_t kPiece = 1U << 20U;  // zlib counts bytes with 32 bits
constexpr int kMemoryLevel = 9;

}  // namespace

GzipReader::GzipReader(const std::vector<unsigned char>& bytes, std::string name)
    : next_(bytes.data()), left_(bytes.size()), name_(std::move(name)) {
  APVI_CHECK(inflateInit2(&stream_, kGzip) == Z_OK);
}

GzipReader::~GzipReader() {
  inflateEnd(&stream_);
}

void GzipReader::read(unsigned char* to, std::size_t size) {
  while (size > 0) {
    if (ended_) fail_input("{}: the compressed data end early", name_);
    const std::size_t in = std::min(kPiece, left_);
    const std::size_t out = std::min(kPiece, size);
    stream_.next_in = const_cast<unsigned char*>(next_);
    stream_.avail_in = static_cast<uInt>(in);
    stream_.next_out = to;
    stream_.avail_out = static_cast<uInt>(out);
    const int status = inflate(&stream_, Z_NO_FLUSH);
    next_ += in - stream_.avail_in;
    left_ -= in - stream_.avail_in;
    to += out - stream_.avail_out;
    size -= out - stream_.avail_out;
    if (status == Z_BUF_ERROR) fail_input("{}: the compressed data are truncated", name_);
    if (status != Z_OK && status != Z_STREAM_END) {
      fail_input("{}: the compressed data are damaged", name_);
    }
    ended_ = status == Z_STREAM_END;
  }
}

void write_gzip(std::ostream& out, const std::vector<unsigned char>& bytes) {
  z_stream stream{};
  APVI_CHECK(deflateInit2(&stream, Z_DEFAULT_COMPRESSION, Z_DEFLATED, kGzip, kMemoryLevel,
                          Z_DEFAULT_STRATEGY) == Z_OK);
  std::vector<unsigned char> buffer(kPiece);
  std::size_t begin = 0;
  int status = Z_OK;
  while (status != Z_STREAM_END) {
    const std::size_t left = bytes.size() - begin;
    const std::size_t in = std::min(kPiece, left);
    stream.next_in = const_cast<unsigned char*>(bytes.data()) + begin;
    stream.avail_in = static_cast<uInt>(in);
    stream.next_out = buffer.data();
    stream.avail_out = static_cast<uInt>(buffer.size());
    status = deflate(&stream, in == left ? Z_FINISH : Z_NO_FLUSH);
    begin += in - stream.avail_in;
    out.write(reinterpret_cast<const char*>(buffer.data()),
              static_cast<std::streamsize>(buffer.size() - stream.avail_out));
  }
  deflateEnd(&stream);
}

}  // namespace apvi::map_io
