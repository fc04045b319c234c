// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <condition_variable>
#include <cstddef>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <set>
#include <stop_token>
#include <string>
#include <thread>

#include "live/clock_aligner.hpp"
#include "live/link.hpp"

namespace apvi::live {

/// lost: nothing arrives, or the connection failed; it is tried again. ended: a recording is over.
enum class ConnectionState { connecting, receiving, lost, ended };
std::string_view to_string(ConnectionState state);

struct SourceStatus {
  std::string name;
  ConnectionState state = ConnectionState::connecting;
  Stamp since;              ///< of the state, host's clock
  std::size_t samples = 0;  ///< handed on
  std::size_t warm_up = 0;  ///< discarded until the device's clock was known
  std::size_t malformed = 0;
  std::size_t losses = 0;
  std::size_t clock_steps = 0;
};

struct SourceOptions {
  std::string name;             ///< for messages: the address as the user gave it
  std::set<std::string> kinds;  ///< of samples it may deliver: "imu", "dvl", …
  double silence_s = 3.0;       ///< without samples the source is lost
  bool reopen_when_silent = true;
  double first_retry_s = 0.5;
  double last_retry_s = 5.0;
};

/// A device, or a recording played at its pace: connects on its own thread, tries again when the
/// connection fails (at growing intervals), and hands on samples stamped by the host's clock.
class Source : private Receiver {
 public:
  /// Opens a link; may be called again and again. Throws RunError when there is none.
  using Open = std::function<std::unique_ptr<Link>(std::stop_token)>;
  /// Takes samples, on the source's thread. The event's stamp is by the host's clock.
  using Sink = std::function<void(SensorEvent event, Stamp arrival)>;

  Source(SourceOptions options, Open open) : options_(std::move(options)), open_(std::move(open)) {}
  ~Source() override { stop(); }
  Source(const Source&) = delete;
  Source& operator=(const Source&) = delete;

  /// Begins to deliver. Called once.
  void start(Sink sink);
  /// Asks the thread to end, without waiting for it.
  void request_stop() { thread_.request_stop(); }
  /// Ends at once; nothing is delivered afterwards.
  void stop();

  const std::set<std::string>& kinds() const { return options_.kinds; }
  /// Thread-safe.
  SourceStatus status() const;

 private:
  void sample(SensorEvent event, const ClockReading& reading) override;
  void clock(const ClockReading& reading) override;
  void malformed(std::string_view reason) override;

  void run(std::stop_token stop);
  bool use_link(std::stop_token stop);
  void check_silence();
  void lost(const std::string& reason);
  void enter(ConnectionState state);
  bool wait(std::stop_token stop, double seconds);

  SourceOptions options_;
  Open open_;
  Sink sink_;
  std::map<std::size_t, ClockAligner> clocks_;
  Stamp last_sample_;  // or when the link was opened
  double retry_s_ = 0.0;
  mutable std::mutex mutex_;
  std::condition_variable_any stopped_;
  SourceStatus status_;  // guarded by mutex_
  std::jthread thread_;  // last: it uses the others
};

}  // namespace apvi::live
