// SPDX-License-Identifier: BSD-3-Clause
// Accuracy and run time of keyframe depth estimation, with ground-truth poses, against the true
// depth of a simulated dataset:
//   depth_bench DATASET [--spacing M] [--lag N] [--every N] [--threads T] [--images DIR]
//               [--device cuda] [--only CASE] [--set key=value]...
// A keyframe is selected every M meters (--spacing). Depth is estimated for every N-th frame
// (--every) with true depth, from nine keyframes of which the last N (--lag) are later. One line
// per case:
//   blocks        blocks per keyframe
//   all, conf     median relative error [%] at the block centers, of all and of confident blocks
//   out, out_c    blocks with an error above 10 % [%], of all and of confident blocks
//   conf%, area   confident blocks [%], and the fraction of the image that they cover [%]
//   dense, mean   median and mean relative error [%] of all pixels, after upsampling
//   ms, core ms   wall time and CPU time per keyframe
#include <torch/torch.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <ctime>
#include <deque>
#include <filesystem>
#include <fstream>
#include <map>
#include <opencv2/imgproc.hpp>
#include <optional>
#include <string>
#include <vector>

#include "apvi/core/error.hpp"
#include "apvi/depth/options.hpp"
#include "apvi/io/sequence.hpp"
#include "apvi/io/tum.hpp"
#include "apvi/sensors/rig.hpp"
#include "core/stopwatch.hpp"
#include "depth/depth.hpp"
#include "runs/views/image_files.hpp"
#include "slam/camera_conversion.hpp"

namespace apvi {
namespace {

namespace fs = std::filesystem;
using torch::Tensor;

constexpr double kMaxGap_s = 0.1;
constexpr double kOutlierError = 0.1;
constexpr std::size_t kNeighbors = 9;

struct Arguments {
  fs::path dataset;
  fs::path images;
  std::string only;
  double spacing_m = 0.12;
  std::size_t lag = 2;
  std::size_t every = 5;
  int threads = 2;
  torch::Device device = torch::kCPU;
  std::vector<std::string> overrides;
};

Arguments parse(int argc, char** argv) {
  if (argc < 2 || argc % 2 != 0) fail_input("usage: depth_bench DATASET [--key value]...");
  Arguments out;
  out.dataset = argv[1];
  for (int i = 2; i < argc; i += 2) {
    const std::string key = argv[i];
    const std::string value = argv[i + 1];
    if (key == "--spacing") {
      out.spacing_m = std::stod(value);
    } else if (key == "--lag") {
      out.lag = std::stoul(value);
    } else if (key == "--every") {
      out.every = std::stoul(value);
    } else if (key == "--threads") {
      out.threads = std::stoi(value);
    } else if (key == "--device") {
      out.device = torch::Device(value);
    } else if (key == "--images") {
      out.images = value;
    } else if (key == "--only") {
      out.only = value;
    } else if (key == "--set") {
      out.overrides.push_back(value);
    } else {
      fail_input("unknown option {}", key);
    }
  }
  return out;
}

depth::DepthOptions read_options(const Arguments& arguments) {
  config::Node root;
  for (const std::string& assignment : arguments.overrides) {
    config::apply_override(root, assignment);
  }
  runs::DepthSection section;
  if (!root.is_null()) config::read(root, section);
  return section.options();
}

struct Case {
  std::string name;
  depth::DepthOptions options;
};

std::vector<Case> cases(const Arguments& arguments) {
  const depth::DepthOptions base = read_options(arguments);
  std::vector<Case> out = {{"quadtree", base}};
  for (const int side : {4, 8, 16}) {
    depth::DepthOptions grid = base;
    grid.quadtree.max_block_px = side;
    grid.quadtree.min_block_px = side;
    out.push_back({"grid-" + std::to_string(side), grid});
  }
  const std::size_t with_propagation = out.size();
  for (std::size_t i = 0; i < with_propagation; ++i) {
    out.push_back({out[i].name + "-alone", out[i].options});
    out.back().options.belief_propagation.enabled = false;
  }
  if (!arguments.only.empty()) {
    std::erase_if(out, [&](const Case& c) { return c.name != arguments.only; });
  }
  return out;
}

cv::Mat read_pfm(const fs::path& path) {
  std::ifstream in(path, std::ios::binary);
  std::string magic;
  int width = 0;
  int height = 0;
  double scale = 0.0;
  in >> magic >> width >> height >> scale;
  in.get();
  cv::Mat upside_down(height, width, CV_32F);
  in.read(upside_down.ptr<char>(), static_cast<std::streamsize>(width) * height * 4);
  if (!in || magic != "Pf" || scale > 0.0)
    fail_input("{}: not a little-endian grayscale PFM file", path.string());
  cv::Mat image;
  cv::flip(upside_down, image, 0);
  return image;
}

struct Job {
  std::string stamp;
  depth::DepthRequest request;
  Tensor truth;  ///< [H,W]
};

io::DatasetConfig recording(const fs::path& folder) {
  io::DatasetConfig config;
  config.path = folder.string();
  return config;
}

/// Builds depth estimation requests from a dataset.
class Jobs {
 public:
  explicit Jobs(const Arguments& arguments)
      : arguments_(arguments),
        config_(recording(arguments.dataset)),
        reader_(io::open_sequence(config_, {"camera"})),
        camera_(make_rig(reader_->rig()).cameras.front()),
        undistort_(camera_.model, 1.0),
        poses_(io::read_trajectory(arguments.dataset / "truth" / "trajectory.tum")) {
    make_map();
  }

  std::vector<Job> read() {
    while (const auto event = reader_->next()) {
      const auto* const frame = std::get_if<ImageFrame>(&*event);
      if (frame != nullptr && frame->camera == 0) process_frame(*frame);
    }
    return std::move(done_);
  }

 private:
  void process_frame(const ImageFrame& frame) {
    const auto T_world_body = poses_.at(frame.stamp, Duration::from_seconds(kMaxGap_s));
    if (!T_world_body) return;
    const SE3 T_world_camera = *T_world_body * camera_.T_body_camera;
    const std::string stamp = std::to_string(frame.stamp.ns);
    const fs::path truth = arguments_.dataset / "truth" / "depth" / (stamp + ".pfm");
    const bool is_target = fs::exists(truth) && count_++ % arguments_.every == 0;
    const bool moved =
        !last_ || (T_world_camera.translation - *last_).norm() >= arguments_.spacing_m;
    if (!is_target && !moved) return;
    const depth::DepthView view = {
        .gray = depth::to_gray(slam::to_tensor(undistort_(frame.decode()))),
        .camera = {.intrinsics = undistort_.intrinsics(),
                   .T_camera_world = slam::to_tensor(T_world_camera.inverse()),
                   .pose_delta = {}}};
    if (moved) {
      last_ = T_world_camera.translation;
      add_keyframe(view);
    }
    if (is_target) start_job(stamp, view, moved, truth);
  }

  void add_keyframe(const depth::DepthView& view) {
    window_.push_front(view);
    if (window_.size() > kNeighbors + 1) window_.pop_back();
    for (auto& waiting : waiting_) {
      waiting.job.request.views.push_back(view);
      if (++waiting.later == arguments_.lag) finish(waiting);
    }
    std::erase_if(waiting_, [&](const Waiting& w) { return w.later >= arguments_.lag; });
  }

  struct Waiting {
    Job job;
    std::vector<depth::DepthView> earlier;
    std::size_t later = 0;
  };

  void start_job(const std::string& stamp, const depth::DepthView& view, bool is_keyframe,
                 const fs::path& truth) {
    Waiting waiting = {.job = {.stamp = stamp, .request = {{view}, {}}, .truth = warp(truth)},
                       .earlier = {window_.begin() + (is_keyframe ? 1 : 0), window_.end()},
                       .later = 0};
    if (arguments_.lag == 0) {
      finish(waiting);
    } else {
      waiting_.push_back(std::move(waiting));
    }
  }

  void finish(Waiting& waiting) {
    auto& views = waiting.job.request.views;
    for (const auto& view : waiting.earlier) {
      if (views.size() < kNeighbors + 1) views.push_back(view);
    }
    if (views.size() == kNeighbors + 1) done_.push_back(std::move(waiting.job));
  }

  void make_map() {
    const gaussians::Intrinsics& k = undistort_.intrinsics();
    map_.create(k.height, k.width, CV_32FC2);
    for (int y = 0; y < k.height; ++y) {
      for (int x = 0; x < k.width; ++x) {
        const auto pixel =
            camera_.model.project({(x + 0.5 - k.cx) / k.fx, (y + 0.5 - k.cy) / k.fy, 1.0});
        if (!pixel) fail_run("cannot project all pixels of the undistorted camera");
        map_.at<cv::Vec2f>(y, x) = {static_cast<float>(pixel->x()), static_cast<float>(pixel->y())};
      }
    }
  }

  Tensor warp(const fs::path& truth) const {
    cv::Mat depth;
    cv::remap(read_pfm(truth), depth, map_, {}, cv::INTER_NEAREST, cv::BORDER_CONSTANT);
    return torch::from_blob(depth.data, {depth.rows, depth.cols}, torch::kFloat32).clone();
  }

  Arguments arguments_;
  io::DatasetConfig config_;
  std::unique_ptr<io::SequenceReader> reader_;
  CameraCalibration camera_;
  slam::Undistorter undistort_;
  Trajectory poses_;
  cv::Mat map_;
  std::optional<Eigen::Vector3d> last_;
  std::size_t count_ = 0;
  std::deque<depth::DepthView> window_;
  std::vector<Waiting> waiting_;
  std::vector<Job> done_;
};

double median(std::vector<double> values) {
  std::sort(values.begin(), values.end());
  return values[values.size() / 2];
}

/// Results over all keyframes of a case.
struct CaseResult {
  std::vector<Tensor> errors;     ///< relative, at representatives
  std::vector<Tensor> confident;  ///< bool
  std::vector<Tensor> areas;
  std::vector<Tensor> dense;  ///< relative, of pixels
  std::vector<double> seconds;
  std::vector<double> core_seconds;

  void add(const depth::DepthEstimate& out, const Tensor& truth) {
    const Tensor at = (out.points - 0.5).round().to(torch::kInt64);
    const Tensor pixel = at.select(1, 1) * truth.size(1) + at.select(1, 0);
    const Tensor z = truth.reshape({-1}).index_select(0, pixel);
    const Tensor known = z > 0;
    Tensor area = torch::empty({z.numel()});
    for (std::size_t i = 0; i < out.blocks.size(); ++i) {
      area.data_ptr<float>()[i] = static_cast<float>(out.blocks[i].width * out.blocks[i].height);
    }
    errors.push_back(((out.depth - z).abs() / z).masked_select(known));
    confident.push_back(out.confident.masked_select(known));
    areas.push_back(area.masked_select(known));
    dense.push_back(((out.dense - truth).abs() / truth).masked_select(truth > 0));
  }

  void print(const std::string& name) const {
    const auto percent = [](const Tensor& x) { return 100.0 * x.item<double>(); };
    const Tensor e = torch::cat(errors);
    const Tensor c = torch::cat(confident);
    const Tensor a = torch::cat(areas);
    const Tensor d = torch::cat(dense);
    const Tensor sure = e.masked_select(c);
    std::printf(
        "%-15s %7.0f %7.2f %7.2f %7.2f %7.2f %7.1f %7.1f %7.2f %7.2f %7.0f %7.0f\n", name.c_str(),
        static_cast<double>(e.numel()) / static_cast<double>(errors.size()), percent(e.median()),
        percent(sure.median()), percent((e > kOutlierError).to(torch::kFloat32).mean()),
        percent((sure > kOutlierError).to(torch::kFloat32).mean()),
        percent(c.to(torch::kFloat32).mean()), percent(a.masked_select(c).sum() / a.sum()),
        percent(d.median()), percent(d.mean()), 1e3 * median(seconds), 1e3 * median(core_seconds));
    std::fflush(stdout);
  }
};

/// Blue: near, red: far, black: unknown.
Tensor colored(const Tensor& depth, double near, double far) {
  const Tensor x = ((depth - near) / (far - near)).clamp(0.0, 1.0);
  const Tensor known = (depth > 0).to(torch::kFloat32);
  return torch::stack({(1.5 - (4.0 * x - 3.0).abs()).clamp(0.0, 1.0) * known,
                       (1.5 - (4.0 * x - 2.0).abs()).clamp(0.0, 1.0) * known,
                       (1.5 - (4.0 * x - 1.0).abs()).clamp(0.0, 1.0) * known},
                      2);
}

void draw_panels(const fs::path& folder, const std::string& name, const Job& job,
                 const depth::DepthEstimate& out) {
  const Tensor sorted = std::get<0>(job.truth.reshape({-1}).sort());
  const auto near = sorted[sorted.numel() / 100].item<double>();
  const auto far = sorted[sorted.numel() * 99 / 100].item<double>();
  Tensor blocks = torch::zeros_like(job.truth);
  Tensor sure = torch::zeros_like(job.truth);
  for (std::size_t i = 0; i < out.blocks.size(); ++i) {
    const auto& b = out.blocks[i];
    const auto k = static_cast<std::int64_t>(i);
    const auto depth = out.depth[k].item<float>();
    blocks.slice(0, b.y, b.y + b.height).slice(1, b.x, b.x + b.width).fill_(depth);
    if (out.confident[k].item<bool>()) {
      sure.slice(0, b.y, b.y + b.height).slice(1, b.x, b.x + b.width).fill_(depth);
    }
  }
  const Tensor gray = job.request.views.front().gray.unsqueeze(2).expand({-1, -1, 3});
  const Tensor top =
      torch::cat({gray, colored(job.truth, near, far), colored(out.dense, near, far)}, 1);
  const Tensor error = ((out.dense - job.truth).abs() / job.truth / kOutlierError).clamp(0.0, 1.0);
  const Tensor below = torch::cat({error.unsqueeze(2).expand({-1, -1, 3}),
                                   colored(blocks, near, far), colored(sure, near, far)},
                                  1);
  fs::create_directories(folder);
  runs::write_png(folder / (job.stamp + "_" + name + ".png"),
                  torch::cat({top, below}, 0).contiguous());
}

depth::DepthRequest on_device(depth::DepthRequest request, const torch::Device& device) {
  for (depth::DepthView& view : request.views) view.gray = view.gray.to(device);
  if (device.is_cuda()) torch::cuda::synchronize();
  return request;
}

void run(const Arguments& arguments) {
  torch::set_num_threads(arguments.threads);
  const std::vector<Job> jobs = Jobs(arguments).read();
  if (jobs.empty()) fail_input("{}: no frame with true depth found", arguments.dataset.string());
  std::printf("%zu keyframes of %s\n%-15s %7s %7s %7s %7s %7s %7s %7s %7s %7s %7s %7s\n",
              jobs.size(), arguments.dataset.filename().c_str(), "case", "blocks", "all", "conf",
              "out", "out_c", "conf%", "area", "dense", "mean", "ms", "core ms");
  for (const Case& c : cases(arguments)) {
    CaseResult result;
    depth::estimate_depth(on_device(jobs.front().request, arguments.device), c.options);  // warm-up
    for (const Job& job : jobs) {
      const depth::DepthRequest request = on_device(job.request, arguments.device);
      const Stopwatch watch;
      const std::clock_t clock = std::clock();
      const depth::DepthEstimate out = depth::estimate_depth(request, c.options);
      result.seconds.push_back(watch.seconds());
      result.core_seconds.push_back(static_cast<double>(std::clock() - clock) / CLOCKS_PER_SEC);
      result.add(out, job.truth);
      if (!arguments.images.empty()) draw_panels(arguments.images, c.name, job, out);
    }
    result.print(c.name);
  }
}

}  // namespace
}  // namespace apvi

int main(int argc, char** argv) {
  try {
    apvi::run(apvi::parse(argc, argv));
    return 0;
  } catch (const std::exception& error) {
    std::fprintf(stderr, "depth_bench: %s\n", error.what());
    return 2;
  }
}
