// SPDX-License-Identifier: BSD-3-Clause
// Speed of the rasterizer: forward pass, forward and backward pass with gradients of all
// parameters, and a full training step (rendering, L1 and D-SSIM, backward pass, Adam over all
// parameters). Prints one line of JSON:
//   raster_bench MAP.ply [--copies N] [--size WxH] [--degree D] [--threads T] [--repeats R]
//                [--device cpu|cuda] [--order file|morton]
// renders N x N copies of the map, 4 m apart, from the camera of the garden's reference image; with
// `--order morton` the Gaussians are sorted in Morton order first. On a GPU, times are measured by
// CUDA events, one call at a time; `_streamed` times are for back-to-back calls, divided by their
// number, as in training. The lower bounds are the bytes that must be moved divided by the copy
// bandwidth.
#include <torch/torch.h>
#if APVI_WITH_CUDA
#include <ATen/cuda/CUDAEvent.h>
#endif

#include <algorithm>
#include <cstdio>
#include <fstream>
#include <functional>
#include <stdexcept>
#include <string>
#include <thread>
#include <vector>

#include "core/stopwatch.hpp"
#include "gaussians/device.hpp"
#include "gaussians/metrics/losses.hpp"
#include "gaussians/model/morton.hpp"
#include "gaussians/optimizer/adam.hpp"
#include "gaussians/render/raster_backend.hpp"
#include "gaussians/render/render.hpp"
#include "map_io/ply.hpp"
#include "medium/medium_backend.hpp"

namespace apvi::gaussians {
namespace {

using torch::Tensor;

constexpr double kSpacing_m = 4.0;
constexpr double kSsimWeight = 0.2;
constexpr double kRate = 1e-9;  // so small that the scene stays the same

struct Arguments {
  std::string map;
  int copies = 1;
  int width = 640;
  int height = 480;
  int degree = 3;
  int threads =
      static_cast<int>(std::thread::hardware_concurrency());  // LibTorch's default is often 1
  int repeats = 15;
  torch::Device device = active_device();
  bool morton = false;
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
    } else if (key == "--device") {
      out.device = torch::Device(value);
    } else if (key == "--order" && (value == "file" || value == "morton")) {
      out.morton = value == "morton";
    } else {
      throw std::runtime_error("unknown option " + key);
    }
  }
  return out;
}

/// Copies of the map side by side, with the SH coefficients of the degree (noise for missing ones).
Gaussians make_map(const Arguments& arguments) {
  const Gaussians one = map_io::read_ply(arguments.map);
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
    *out.tensors()[k] = torch::cat(parts).to(arguments.device);
  }
  const Tensor order = morton_order(out.means);
  for (Tensor* tensor : out.tensors()) {
    if (arguments.morton) *tensor = tensor->index_select(0, order);
    tensor->requires_grad_(true);
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

/// Measures time and memory on the device.
class Meter {
 public:
  explicit Meter(const torch::Device& device) : device_(device) {}

  /// Seconds between the start and the end of the work that `f` submits to the device.
  double seconds(const std::function<void()>& f) const {
#if APVI_WITH_CUDA
    if (device_.is_cuda()) {
      at::cuda::CUDAEvent begin(cudaEventDefault);
      at::cuda::CUDAEvent end(cudaEventDefault);
      torch::cuda::synchronize();
      begin.record();
      f();
      end.record();
      end.synchronize();
      return 1e-3 * static_cast<double>(begin.elapsed_time(end));
    }
#endif
    const Stopwatch watch;
    f();
    return watch.seconds();
  }

  /// Resets the peak memory.
  void reset_peak() {
    if (device_.is_cuda()) return reset_peak_memory();
    before_mib_ = status_mib("VmRSS:");
    std::ofstream("/proc/self/clear_refs") << "5";
  }
  /// Peak memory [MiB] since the reset: total on a GPU, increase over the RSS at the reset on the
  /// CPU.
  double peak_mib() const {
    if (device_.is_cuda()) return device_memory()->peak_mib;
    return status_mib("VmHWM:") - before_mib_;
  }

 private:
  torch::Device device_;
  double before_mib_ = 0.0;
};

struct Timing {
  double median_ms = 0.0;
  double min_ms = 0.0;
  double streamed_ms = 0.0;
};

/// Median over the repeats, after three warm-up runs. `prepare` is not timed.
Timing measure(const Meter& meter, int repeats, const std::function<void()>& prepare,
               const std::function<void()>& run) {
  std::vector<double> ms;
  for (int i = -3; i < repeats; ++i) {
    prepare();
    const double seconds = meter.seconds(run);
    if (i >= 0) ms.push_back(1e3 * seconds);
  }
  std::sort(ms.begin(), ms.end());
  const double all = meter.seconds([&] {
    for (int i = 0; i < repeats; ++i) {
      prepare();
      run();
    }
  });
  return {ms[ms.size() / 2], ms.front(), 1e3 * all / repeats};
}

/// Copy bandwidth of the device [bytes/s], counting reads and writes.
double copy_rate(const Meter& meter, const torch::Device& device) {
  const Tensor from = torch::ones({1 << 26}, torch::dtype(torch::kFloat32).device(device));
  Tensor to = torch::empty_like(from);
  std::vector<double> seconds;
  for (int i = 0; i < 7; ++i) seconds.push_back(meter.seconds([&] { to.copy_(from); }));
  std::sort(seconds.begin(), seconds.end());
  return 8.0 * static_cast<double>(from.numel()) / seconds[3];
}

Tensor zero_moment(const Tensor& parameter) {
  return torch::zeros_like(parameter, parameter.options().dtype(moment_type(parameter)))
      .requires_grad_(false);
}

class Bench {
 public:
  explicit Bench(const Arguments& arguments)
      : map_(make_map(arguments)), view_(make_view(arguments)) {
    torch::manual_seed(1);
    target_ = torch::rand({arguments.height, arguments.width, 3}).to(arguments.device);
    for (const Tensor* tensor : std::as_const(map_).tensors()) {
      groups_.push_back({.parameter = tensor->detach(),
                         .gradient = {},
                         .first = zero_moment(*tensor),
                         .second = zero_moment(*tensor),
                         .rate = kRate});
    }
  }

  std::int64_t size() const { return map_.size(); }
  /// Bytes of the parameters.
  double bytes() const {
    double sum = 0.0;
    for (const AdamGroup& group : groups_) sum += static_cast<double>(group.parameter.nbytes());
    return sum;
  }
  /// Minimum bytes that an Adam step reads and writes.
  double adam_bytes() const {
    double sum = 0.0;
    for (const AdamGroup& group : groups_) {
      const std::size_t moments = group.first.nbytes() + group.second.nbytes();
      sum += 2.0 * static_cast<double>(group.parameter.nbytes() + moments);
    }
    return sum;
  }

  void forward() const {
    const torch::NoGradGuard no_grad;
    render(map_, view_, {});
  }

  /// Without the loss: uses a given image gradient. `rows`: sparse gradients, as in training.
  void forward_backward(bool sparse) {
    const RenderOutput rendered =
        render(map_, view_, {.background = {}, .sparse_gradient = sparse});
    rendered.color.backward(target_);
  }

  void training_step() {
    const RenderOutput rendered = render(map_, view_, {.background = {}, .sparse_gradient = true});
    photometric_loss(rendered.color, target_, kSsimWeight).backward();
    if (rendered.sparse_gradient != nullptr)
      return adam_step_sparse(groups_, *rendered.sparse_gradient, ++steps_);
    for (std::size_t k = 0; k < groups_.size(); ++k) {
      groups_[k].gradient = map_.tensors()[k]->grad();
    }
    adam_step(groups_, ++steps_);
  }

  void clear() {
    for (AdamGroup& group : groups_) group.gradient = Tensor();
    for (Tensor* tensor : map_.tensors()) tensor->mutable_grad() = Tensor();
  }

 private:
  Gaussians map_;
  View view_;
  Tensor target_;
  std::vector<AdamGroup> groups_;
  std::int64_t steps_ = 0;
};

void print_timing(const char* name, const Timing& timing) {
  std::printf(R"("%s_ms": %.3f, "%s_min_ms": %.3f, "%s_streamed_ms": %.3f, )", name,
              timing.median_ms, name, timing.min_ms, name, timing.streamed_ms);
}

void run(const Arguments& arguments) {
  torch::set_num_threads(std::max(arguments.threads, 1));
  Meter meter(arguments.device);
  const double rate = copy_rate(meter, arguments.device);
  Bench bench(arguments);
  const auto clear = [&] { bench.clear(); };
  meter.reset_peak();
  const Timing forward = measure(meter, arguments.repeats, clear, [&] { bench.forward(); });
  const Timing dense =
      measure(meter, arguments.repeats, clear, [&] { bench.forward_backward(false); });
  const Timing both =
      measure(meter, arguments.repeats, clear, [&] { bench.forward_backward(true); });
  const double render_mib = meter.peak_mib();
  bench.clear();
  meter.reset_peak();
  const Timing step = measure(meter, arguments.repeats, clear, [&] { bench.training_step(); });
  const double forward_floor_ms = 1e3 * bench.bytes() / rate;
  const double adam_floor_ms = 1e3 * bench.adam_bytes() / rate;
  std::printf(R"({"gaussians": %lld, "width": %d, "height": %d, "sh_degree": %d, "threads": %d, )"
              R"("backend": "%s", )",
              static_cast<long long>(bench.size()), arguments.width, arguments.height,
              arguments.degree, torch::get_num_threads(),
              raster_backend(arguments.device).name().data());
  print_timing("forward", forward);
  print_timing("forward_backward", both);
  print_timing("forward_backward_dense", dense);
  print_timing("training_step", step);
  std::printf(R"("render_mib": %.1f, "step_mib": %.1f, "copy_gb_s": %.0f, )"
              R"("all_parameters_read_ms": %.3f, "adam_floor_ms": %.3f})"
              "\n",
              render_mib, meter.peak_mib(), 1e-9 * rate, forward_floor_ms, adam_floor_ms);
}

}  // namespace
}  // namespace apvi::gaussians

int main(int argc, char** argv) {
  try {
    apvi::gaussians::run(apvi::gaussians::parse(argc, argv));
    return 0;
  } catch (const std::exception& error) {
    std::fprintf(stderr, "raster_bench: %s\n", error.what());
    return 2;
  }
}
