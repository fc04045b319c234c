// SPDX-License-Identifier: BSD-3-Clause
#include "live/video_link.hpp"

#include <unistd.h>

#include <algorithm>
#include <array>
#include <cstdlib>
#include <filesystem>
#include <mutex>
#include <string_view>
#include <thread>
#include <utility>

#include "apvi/core/error.hpp"
#include "apvi/io/tum.hpp"
#include "core/text.hpp"
#include "live/host_clock.hpp"
#include "live/socket.hpp"

namespace apvi::live {
namespace {

namespace fs = std::filesystem;

constexpr int kTimeout_ms = 1000;  // of a read, in which a stop waits

/// A session description, by which FFmpeg receives RTP without a server.
class SessionFile {
 public:
  explicit SessionFile(const Address& address)
      : path_(fs::temp_directory_path() / fmt::format("apvi-{}-{}.sdp", getpid(), address.port)) {
    const std::string host = address.host.empty() ? "0.0.0.0" : address.host;
    io::write_text_file(path_,
                        fmt::format("v=0\no=- 0 0 IN IP4 {0}\ns=camera\nc=IN IP4 {0}\nt=0 0\n"
                                    "m=video {1} RTP/AVP 96\na=rtpmap:96 H264/90000\n",
                                    host, address.port));
  }
  ~SessionFile() {
    std::error_code ignored;
    fs::remove(path_, ignored);
  }
  SessionFile(const SessionFile&) = delete;
  SessionFile& operator=(const SessionFile&) = delete;
  std::string path() const { return path_.string(); }

 private:
  fs::path path_;
};

cv::VideoCapture open_ffmpeg(const std::string& name) {
  cv::VideoCapture capture;
  capture.open(name, cv::CAP_FFMPEG,
               {cv::CAP_PROP_OPEN_TIMEOUT_MSEC, 5 * kTimeout_ms, cv::CAP_PROP_READ_TIMEOUT_MSEC,
                kTimeout_ms});
  return capture;
}

cv::VideoCapture open(const VideoOptions& options) {
  // OpenCV takes FFmpeg's options from the environment, which only one thread may change.
  static std::mutex mutex;
  const std::scoped_lock lock(mutex);
  setenv("OPENCV_FFMPEG_CAPTURE_OPTIONS",
         "protocol_whitelist;file,rtp,udp,tcp,rtsp,crypto|fflags;nobuffer|flags;low_delay", 0);
  const SourceUrl& url = options.url;
  if (url.scheme == "v4l2") return cv::VideoCapture(url.target, cv::CAP_V4L2);
  if (url.scheme == "rtp+h264") {
    const auto address = parse_address(url.target);
    if (!address) fail_run("{}: expected rtp+h264://:PORT", url.text);
    const SessionFile session(*address);
    return open_ffmpeg(session.path());
  }
  return open_ffmpeg(url.scheme == "rtsp" ? url.text : url.target);
}

}  // namespace

bool is_video_scheme(const std::string& scheme) {
  constexpr std::array<std::string_view, 4> kSchemes = {"rtsp", "rtp+h264", "v4l2", "video"};
  return std::ranges::find(kSchemes, scheme) != kSchemes.end();
}

VideoOptions video_options(const SourceUrl& url) {
  url.check_options({"camera", "delay_s"});
  return {.url = url,
          .camera = static_cast<int>(url.number("camera", 0.0, 0.0, 1.0)),
          .delay_s = url.number("delay_s", 0.0, 0.0, 10.0)};
}

VideoLink::VideoLink(const VideoOptions& options)
    : options_(options), capture_(open(options)), is_file_(options.url.scheme == "video") {
  if (!capture_.isOpened()) fail_run("no video");
}

bool VideoLink::receive(Receiver& receiver) {
  if (!next_ms_) {
    if (!capture_.grab()) {
      if (is_file_) return false;
      fail_run("no image");
    }
    next_ms_ = capture_.get(cv::CAP_PROP_POS_MSEC);
  }
  if (is_file_ && !wait_until_due()) return true;
  const Stamp arrival = host_now();
  cv::Mat image;
  const bool decoded = capture_.retrieve(image);
  const ClockReading reading = reading_at(arrival);
  next_ms_.reset();
  if (!decoded || image.empty()) {
    receiver.malformed("an image that cannot be decoded");
    return true;
  }
  const Stamp stamp = reading.sent - Duration::from_seconds(options_.delay_s);
  receiver.sample(ImageFrame{stamp, options_.camera, [pixels = image.clone()] { return pixels; }},
                  reading);
  return true;
}

bool VideoLink::wait_until_due() {
  if (!began_) began_ = host_now() - Duration::from_seconds(1e-3 * *next_ms_);
  const Stamp due = *began_ + Duration::from_seconds(1e-3 * *next_ms_);
  const Duration ahead = due - host_now();
  if (ahead.ns <= 0) return true;
  std::this_thread::sleep_for(
      std::min(std::chrono::nanoseconds(ahead.ns), std::chrono::nanoseconds(kPollPeriod)));
  return false;
}

// Presentation times that do not increase say nothing.
ClockReading VideoLink::reading_at(Stamp arrival) {
  const bool increases = *next_ms_ > last_ms_;
  last_ms_ = *next_ms_;
  if (!increases) return {.sent = arrival, .arrival = arrival, .clock = 1};
  return {.sent = Stamp{} + Duration::from_seconds(1e-3 * last_ms_), .arrival = arrival};
}

}  // namespace apvi::live
