// SPDX-License-Identifier: BSD-3-Clause
// How fast the rasterizer is: one pass, one pass with derivatives by every parameter, and a whole
// step of training (rendering, L1 and D-SSIM, derivatives, Adam over all parameters). One line of
// JSON a program run:
//   raster_bench MAP.ply [--copies N] [--size WxH] [--degree D] [--threads T] [--repeats R]
// draws the map N x N times, 4 m apart, from where the reference image of the garden was taken.
#include <torch/torch.h>

#include <algorithm>
#include <cstdio>
#include <fstream>
#include <functional>
#include <stdexcept>
#include <string>
#include <thread>
#include <vector>

#include "apvi/core/stopwatch.hpp"
#include "apvi/splat/adam.hpp"
#include "apvi/splat/losses.hpp"
#include "apvi/splat/ply.hpp"
#include "apvi/splat/raster_backend.hpp"
#include "apvi/splat/render.hpp"

namespace apvi::splat {
namespace {

using torch::Tensor;

constexpr double kSpacing_m = 4.0;
constexpr double kSsimWeight = 0.2;
constexpr double kRate = 1e-9;  // every step sees the same scene

struct Arguments {
  std::string map;
  int copies = 1;
  int width = 640;
  int height = 480;
  int degree = 3;
  int threads = static_cast<int>(std::thread::hardware_concurrency());  // LibTorch's is often 1
  int repeats = 15;
};

Arguments parse(int argc, char** argv) {
  if (argc < 2 || argc % 2 != 0)
    throw std::runtime_error("usage: raster_bench MAP.ply [--key value]...");
  Arguments out;
  out.map = argv[1];
  for (int i = 2; i < argc; i += 2) {
    const std::string key = argv[i];
    const std::string value = argv[i + 1];
    if (key == "--size") {
      out.width = std::stoi(value);
      out.height = std::stoi(value.substr(value.find('x') + 1));
    } else if (key == "--copies") {
      out.copies = std::stoi(value);
    } else if (key == "--degree") {
      out.degree = std::stoi(value);
    } else if (key == "--threads") {
      out.threads = std::stoi(value);
    } else if (key == "--repeats") {
      out.repeats = std::stoi(value);
    } else {
      throw std::runtime_error("unknown option " + key);
    }
  }
  return out;
}

/// The map side by side, with as many coefficients as the degree asks for (noise for missing ones).
Gaussians make_map(const Arguments& arguments) {
  const Gaussians one = read_ply(arguments.map);
  const std::int64_t used = std::min(sh_rest_count(arguments.degree), one.sh_rest.size(1));
  const Tensor missing =
      torch::randn({one.size(), sh_rest_count(arguments.degree) - used, 3}) * 0.01;
  std::vector<Gaussians> all;
  for (int i = 0; i < arguments.copies * arguments.copies; ++i) {
    Gaussians copy = one;
    const int row = i / arguments.copies;
    const int column = i % arguments.copies;
    copy.means =
        one.means + torch::tensor({kSpacing_m * column, kSpacing_m * row, 0.0}).to(torch::kFloat32);
    copy.sh_rest = torch::cat({one.sh_rest.slice(1, 0, used), missing}, 1);
    all.push_back(copy);
  }
  Gaussians out;
  for (std::size_t k = 0; k < 6; ++k) {
    std::vector<Tensor> parts;
    for (const Gaussians& copy : all) parts.push_back(*copy.tensors()[k]);
    *out.tensors()[k] = torch::cat(parts).requires_grad_(true);
  }
  return out;
}

View make_view(const Arguments& arguments) {
  const Intrinsics camera = {.fx = 474.6788635253906,
                             .fy = 550.3366088867188,
                             .cx = 320.1851806640625,
                             .cy = 240.07144165039062,
                             .width = 640,
                             .height = 480};
  return {.intrinsics = camera.scaled(arguments.width, arguments.height),
          .T_camera_world =
              torch::tensor(
                  {0.2752179205417633, -0.961380660533905, -0.0015191672137007117,
                   -0.025438308715820312, -0.2117573767900467, -0.059079013764858246,
                   -0.975534975528717, 0.22704041004180908, 0.9377707242965698, 0.2688063979148865,
                   -0.21983905136585236, 1.195468783378601, 0.0, 0.0, 0.0, 1.0},
                  torch::kFloat64)
                  .reshape({4, 4}),
          .pose_delta = {}};
}

double status_mib(const std::string& key) {
  std::ifstream in("/proc/self/status");
  for (std::string line; std::getline(in, line);) {
    if (line.starts_with(key)) return std::stod(line.substr(key.size())) / 1024.0;
  }
  return 0.0;
}

struct Timing {
  double median_ms = 0.0;
  double least_ms = 0.0;
};

/// Median over the repeats, after three runs that do not count. `run` returns seconds.
Timing measure(int repeats, const std::function<double()>& run) {
  std::vector<double> ms;
  for (int i = -3; i < repeats; ++i) {
    const double seconds = run();
    if (i >= 0) ms.push_back(1e3 * seconds);
  }
  std::sort(ms.begin(), ms.end());
  return {ms[ms.size() / 2], ms.front()};
}

class Bench {
 public:
  explicit Bench(const Arguments& arguments)
      : map_(make_map(arguments)), view_(make_view(arguments)) {
    torch::manual_seed(1);
    target_ = torch::rand({arguments.height, arguments.width, 3});
    for (const Tensor* tensor : std::as_const(map_).tensors()) {
      groups_.push_back({.parameter = tensor->detach(),
                         .gradient = {},
                         .first = torch::zeros_like(*tensor),
                         .second = torch::zeros_like(*tensor),
                         .rate = kRate});
    }
  }

  std::int64_t size() const { return map_.size(); }

  double forward() const {
    const torch::NoGradGuard no_grad;
    const Stopwatch watch;
    render(map_, view_, {});
    return watch.seconds();
  }

  /// Without the loss: its derivative by the image is given.
  double forward_backward() {
    clear();
    const Stopwatch watch;
    const RenderOutput drawn = render(map_, view_, {});
    drawn.color.backward(target_);
    return watch.seconds();
  }

  double training_step() {
    clear();
    const Stopwatch watch;
    const RenderOutput drawn = render(map_, view_, {});
    photometric_loss(drawn.color, target_, kSsimWeight).backward();
    for (std::size_t k = 0; k < groups_.size(); ++k) {
      groups_[k].gradient = map_.tensors()[k]->grad();
    }
    adam_step(groups_, ++steps_);
    return watch.seconds();
  }

 private:
  void clear() {
    for (AdamGroup& group : groups_) group.gradient = Tensor();
    for (Tensor* tensor : map_.tensors()) tensor->mutable_grad() = Tensor();
  }

  Gaussians map_;
  View view_;
  Tensor target_;
  std::vector<AdamGroup> groups_;
  std::int64_t steps_ = 0;
};

void run(const Arguments& arguments) {
  torch::set_num_threads(std::max(arguments.threads, 1));
  Bench bench(arguments);
  const double before_mib = status_mib("VmRSS:");
  std::ofstream("/proc/self/clear_refs") << "5";  // the peak starts anew
  const Timing forward = measure(arguments.repeats, [&] { return bench.forward(); });
  const Timing both = measure(arguments.repeats, [&] { return bench.forward_backward(); });
  const double net_mib = status_mib("VmHWM:") - before_mib;
  const Timing step = measure(arguments.repeats, [&] { return bench.training_step(); });
  std::printf(R"({"gaussians": %lld, "width": %d, "height": %d, "sh_degree": %d, "threads": %d, )"
              R"("backend": "%s", "forward_ms": %.2f, "forward_least_ms": %.2f, )"
              R"("forward_backward_ms": %.2f, "forward_backward_least_ms": %.2f, )"
              R"("training_step_ms": %.2f, "training_step_least_ms": %.2f, "net_memory_mib": %.1f})"
              "\n",
              static_cast<long long>(bench.size()), arguments.width, arguments.height,
              arguments.degree, torch::get_num_threads(), raster_backend(torch::kCPU).name().data(),
              forward.median_ms, forward.least_ms, both.median_ms, both.least_ms, step.median_ms,
              step.least_ms, net_mib);
}

}  // namespace
}  // namespace apvi::splat

int main(int argc, char** argv) {
  try {
    apvi::splat::run(apvi::splat::parse(argc, argv));
    return 0;
  } catch (const std::exception& error) {
    std::fprintf(stderr, "raster_bench: %s\n", error.what());
    return 2;
  }
}
