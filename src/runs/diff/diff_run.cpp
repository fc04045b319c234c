// SPDX-License-Identifier: BSD-3-Clause
#include "runs/diff/diff_run.hpp"

#include <array>
#include <system_error>

#include "apvi/core/error.hpp"
#include "apvi/core/log.hpp"
#include "core/status_line.hpp"
#include "runs/diff/diff_files.hpp"
#include "runs/diff/diff_frame.hpp"
#include "runs/diff/diff_images.hpp"
#include "runs/diff/diff_session.hpp"

namespace apvi::runs {
namespace {

namespace fs = std::filesystem;

constexpr double kCompared = 0.8;  // part of the time before images are written
constexpr std::array kFiles = {"changes.json", "changes.csv", "changes.ply", "before.png",
                               "after.png",    "changes.png", "report.html", "images"};

void check(const std::error_code& error, const fs::path& path) {
  if (error) fail_run("{}: {}", path.string(), error.message());
}

/// A folder next to the output, which is removed unless its content has been moved there.
class PartialFolder {
 public:
  explicit PartialFolder(const fs::path& out) : out_(out), path_(name_of(out)) {
    std::error_code error;
    fs::remove_all(path_, error);
    fs::create_directories(path_ / "images", error);
    check(error, path_);
  }
  ~PartialFolder() {
    std::error_code ignored;
    fs::remove_all(path_, ignored);
  }
  PartialFolder(const PartialFolder&) = delete;
  PartialFolder& operator=(const PartialFolder&) = delete;

  const fs::path& path() const { return path_; }

  /// Replaces what an earlier change map left.
  void finish() const {
    std::error_code error;
    fs::create_directories(out_, error);
    check(error, out_);
    for (const char* name : kFiles) {
      fs::remove_all(out_ / name, error);
      if (!fs::exists(path_ / name)) continue;
      fs::rename(path_ / name, out_ / name, error);
      check(error, out_ / name);
    }
  }

 private:
  static fs::path name_of(const fs::path& out) {
    fs::path plain = fs::absolute(out).lexically_normal();
    if (!plain.has_filename()) plain = plain.parent_path();
    return plain.concat(".partial");
  }

  fs::path out_;
  fs::path path_;
};

void check_out(const DiffRequest& r) {
  if (fs::exists(r.out) && !fs::is_directory(r.out)) {
    fail_input("{}: is a file; expected a folder", r.out.string());
  }
  if (fs::exists(r.out / "resolved.yaml")) {
    fail_input("{}: holds a run; choose another folder with -o", r.out.string());
  }
  if (fs::exists(r.out / "changes.json") && !r.overwrite) {
    fail_input("{}: already holds a change map; choose another folder with -o, or use --overwrite",
               r.out.string());
  }
}

DiffSummary summary_of(const change::ChangeMap& map) {
  DiffSummary out{.compared_m2 = map.compared_m2,
                  .unknown_m2 = map.only_before_m2 + map.only_after_m2};
  for (const change::Change& c : map.changes) {
    if (c.kind == change::Kind::appeared) ++out.appeared;
    if (c.kind == change::Kind::vanished) ++out.vanished;
    if (c.kind == change::Kind::color) ++out.color;
  }
  return out;
}

void write_all(const DiffRequest& r, const DiffSessions& sessions, const change::ChangeMap& map,
               const change::Progress& progress) {
  const PartialFolder partial(r.out);
  const DiffColors colors(sessions, map);
  for (std::size_t i = 0; i < map.changes.size(); ++i) {
    const double done = static_cast<double>(i) / static_cast<double>(map.changes.size());
    progress(kCompared + (1.0 - kCompared) * done, "drawing");
    write_change_images(partial.path(), i, sessions, map, colors);
  }
  const double plan_m = write_plan_images(partial.path(), sessions, map, colors);
  const DiffHeader header{r.before, r.after, r.options.min_size_m, plan_m};
  write_change_files(partial.path(), header, sessions, map, colors);
  progress(1.0, "writing");
  partial.finish();
}

}  // namespace

DiffSummary diff_runs(const DiffRequest& r) {
  check_out(r);
  check_mapping_run(r.before);
  check_mapping_run(r.after);
  if (!r.same_frame) check_common_frame(r.before, r.after);
  const DiffSessions sessions = load_sessions(r.before, r.after);
  StatusLine status("comparing");
  const change::Progress progress = [&](double fraction, std::string_view what) {
    if (r.interrupted()) fail_run("{}: interrupted; nothing was written", r.out.string());
    status.update(fraction, what);
  };
  const change::ChangeMap map = change::find_changes(
      sessions.before, sessions.after, r.options,
      [&](double fraction, std::string_view what) { progress(kCompared * fraction, what); });
  write_all(r, sessions, map, progress);
  return summary_of(map);
}

}  // namespace apvi::runs
