// SPDX-License-Identifier: BSD-3-Clause
// Control flow and memory of the CPU rasterizer. The arithmetic is in kernel_*.hpp.
#include <torch/torch.h>

#include <algorithm>
#include <array>
#include <limits>
#include <new>
#include <type_traits>
#include <vector>

#include "cpu_fallback/common/memory_pool.hpp"
#include "cpu_fallback/raster/binning.hpp"
#include "gaussians/render/camera.hpp"
#include "gaussians/render/raster_backend.hpp"

namespace apvi::gaussians {
namespace {

using torch::Tensor;

struct Kernels {
  RasterKernels<float> in_float;
  RasterKernels<double> in_double;
};
template <typename T>
const RasterKernels<T>& kernels_for(const Kernels& kernels) {
  if constexpr (std::is_same_v<T, float>) {
    return kernels.in_float;
  } else {
    return kernels.in_double;
  }
}

std::uint32_t* unsigned_data(const Tensor& tensor) {
  return reinterpret_cast<std::uint32_t*>(tensor.data_ptr<std::int32_t>());
}

/// State saved for the backward pass.
template <typename T>
struct State {
  Tensor splats;       // [N,16]
  Tensor slot_begin;   // [N+1]
  Tensor tile_begin;   // [tiles+1]
  Tensor entries;      // [slots,2]
  Tensor slot_weight;  // [slots]

  static State from(const RasterState& state) {
    return {state[0], state[1], state[2], state[3], state[4]};
  }
  RasterState pack() const { return {splats, slot_begin, tile_begin, entries, slot_weight}; }
  Splat<T>* splat_data() const { return reinterpret_cast<Splat<T>*>(splats.data_ptr<T>()); }
  Entry* entry_data() const { return reinterpret_cast<Entry*>(entries.data_ptr<std::int32_t>()); }
};

template <typename T>
ProjectArgs<T> project_args(const RasterInput& input, const State<T>& state) {
  const Gaussians& g = input.gaussians;
  return {.count = g.size(),
          .means = g.means.data_ptr<T>(),
          .log_scales = g.log_scales.data_ptr<T>(),
          .quaternions = g.quaternions.data_ptr<T>(),
          .logit_opacities = g.logit_opacities.data_ptr<T>(),
          .sh_dc = g.sh_dc.data_ptr<T>(),
          .sh_rest = g.sh_rest.data_ptr<T>(),
          .light = input.light.defined() ? input.light.data_ptr<T>() : nullptr,
          .sh_rest_count = static_cast<int>(g.sh_rest.size(1)),
          .sh_degree = input.sh_degree,
          .width = input.intrinsics.width,
          .height = input.intrinsics.height,
          .antialiased = input.antialiased,
          .camera = make_camera<T>(input.T_camera_world.data_ptr<double>(), input.intrinsics,
                                   input.near_m, input.low_pass_px2),
          .splats = state.splat_data()};
}

template <typename T>
BlendArgs<T> blend_args(const RasterInput& input, const RasterOutput& out, const State<T>& state) {
  const TileGrid grid = {input.intrinsics.width, input.intrinsics.height};
  const auto* const background = input.background.data_ptr<T>();
  return {.width = grid.width,
          .height = grid.height,
          .tiles_x = grid.columns(),
          .splats = state.splat_data(),
          .entries = state.entry_data(),
          .tile_begin = unsigned_data(state.tile_begin),
          .background = {background[0], background[1], background[2]},
          .color = out.color.data_ptr<T>(),
          .depth = out.depth.data_ptr<T>(),
          .alpha = out.alpha.data_ptr<T>(),
          .slot_weight = state.slot_weight.template data_ptr<T>()};
}

/// Range [first, last + 1) of the Gaussians of a chunk.
std::array<std::int64_t, 2> chunk_range(std::int64_t chunk, std::int64_t count) {
  return {chunk * kChunk, std::min((chunk + 1) * kChunk, count)};
}
std::int64_t chunk_count(std::int64_t count) {
  return (count + kChunk - 1) / kChunk;
}

/// Projects all Gaussians and sorts them into tiles.
template <typename T>
State<T> prepare(const RasterKernels<T>& kernels, const RasterInput& input) {
  const std::int64_t n = input.gaussians.size();
  const auto options = input.gaussians.means.options();
  const auto int32 = torch::dtype(torch::kInt32);
  const TileGrid grid = {input.intrinsics.width, input.intrinsics.height};
  State<T> state = {.splats = pooled_empty({n, 16}, options),
                    .slot_begin = pooled_empty({n + 1}, int32),
                    .tile_begin = pooled_empty({grid.count() + 1}, int32),
                    .entries = {},
                    .slot_weight = {}};
  const ProjectArgs<T> args = project_args<T>(input, state);
  std::uint32_t* const slot_begin = unsigned_data(state.slot_begin);
  std::vector<ChunkTiles<T>> chunks(static_cast<std::size_t>(chunk_count(n)));
  for_each_task(chunk_count(n), [&](std::int64_t chunk) {
    const auto [begin, end] = chunk_range(chunk, n);
    kernels.project(args, begin, end);
    chunks[static_cast<std::size_t>(chunk)] =
        list_tiles(args.splats, begin, end, grid, slot_begin + 1);
  });
  std::int64_t slots = 0;
  for (const ChunkTiles<T>& chunk : chunks) slots += static_cast<std::int64_t>(chunk.tiles.size());
  TORCH_CHECK(slots <= std::numeric_limits<std::int32_t>::max(), "render: ", n, " Gaussians touch ",
              slots, " tiles, too many to sort");
  slot_begin[0] = 0;
  for (std::int64_t i = 0; i < n; ++i) slot_begin[i + 1] += slot_begin[i];
  state.entries = pooled_empty({slots, 2}, int32);
  state.slot_weight = pooled_empty({slots}, options);
  const Tensor tile_of_slot = pooled_empty({slots}, int32);
  for_each_task(chunk_count(n), [&](std::int64_t chunk) {
    const auto& tiles = chunks[static_cast<std::size_t>(chunk)].tiles;
    std::copy(tiles.begin(), tiles.end(), unsigned_data(tile_of_slot) + slot_begin[chunk * kChunk]);
  });
  sort_by_tile(sort_by_depth(chunks), slot_begin, unsigned_data(tile_of_slot), grid,
               unsigned_data(state.tile_begin), state.entry_data());
  return state;
}

template <typename T>
void fill_statistics(const State<T>& state, std::int64_t n, const RasterOutput& out) {
  const std::uint32_t* const slot_begin = unsigned_data(state.slot_begin);
  const auto* const weights = state.slot_weight.template data_ptr<T>();
  const Splat<T>* const splats = state.splat_data();
  bool* const visible = out.visible.data_ptr<bool>();
  auto* const radii = out.radii_px.data_ptr<T>();
  auto* const largest = out.max_weight.data_ptr<T>();
  for_each_task(chunk_count(n), [&](std::int64_t chunk) {
    const auto [begin, end] = chunk_range(chunk, n);
    for (std::int64_t i = begin; i < end; ++i) {
      visible[i] = slot_begin[i + 1] > slot_begin[i];
      radii[i] = visible[i] ? splats[i].radius : T(0);
      T best(0);
      for (std::uint32_t k = slot_begin[i]; k < slot_begin[i + 1]; ++k) {
        best = std::max(best, weights[k]);
      }
      largest[i] = best;
    }
  });
}

template <typename T>
RasterOutput forward(const RasterKernels<T>& kernels, const RasterInput& input) {
  const auto options = input.gaussians.means.options();
  const std::int64_t n = input.gaussians.size();
  const std::int64_t height = input.intrinsics.height;
  const std::int64_t width = input.intrinsics.width;
  const State<T> state = prepare<T>(kernels, input);
  RasterOutput out = {.color = pooled_empty({height, width, 3}, options),
                      .depth = pooled_empty({height, width}, options),
                      .alpha = pooled_empty({height, width}, options),
                      .visible = {},
                      .radii_px = {},
                      .max_weight = {},
                      .state = {}};
  const BlendArgs<T> args = blend_args(input, out, state);
  for_each_task(TileGrid{args.width, args.height}.count(),
                [&](std::int64_t tile) { kernels.blend(args, static_cast<int>(tile)); });
  if (input.images_only) return out;
  out.visible = pooled_empty({n}, torch::kBool);
  out.radii_px = pooled_empty({n}, options);
  out.max_weight = pooled_empty({n}, options);
  fill_statistics(state, n, out);
  out.state = state.pack();
  return out;
}

/// Sums parts in a fixed order, independent of threads.
template <std::size_t N>
std::array<double, N> sum_parts(const std::vector<std::array<double, N>>& parts) {
  std::array<double, N> total = {};
  for (const auto& part : parts) {
    for (std::size_t i = 0; i < N; ++i) total[i] += part[i];
  }
  return total;
}

/// Backward pass of blending: the slot gradients; returns the gradient of the background.
template <typename T>
Tensor blend_backward(const RasterKernels<T>& kernels, const BlendArgs<T>& forward,
                      const RasterOutputGradient& grad, const Tensor& slot_gradient) {
  const BlendBackwardArgs<T> args = {
      .forward = forward,
      .grad_color = grad.color.data_ptr<T>(),
      .grad_depth = grad.depth.defined() ? grad.depth.data_ptr<T>() : nullptr,
      .grad_alpha = grad.alpha.defined() ? grad.alpha.data_ptr<T>() : nullptr,
      .slot_gradient = slot_gradient.data_ptr<T>()};
  const int tiles = TileGrid{forward.width, forward.height}.count();
  std::vector<std::array<double, 3>> parts(static_cast<std::size_t>(tiles),
                                           std::array<double, 3>{});
  for_each_task(tiles, [&](std::int64_t tile) {
    kernels.blend_backward(args, static_cast<int>(tile),
                           parts[static_cast<std::size_t>(tile)].data());
  });
  const std::array<double, 3> sum = sum_parts(parts);
  return torch::tensor({sum[0], sum[1], sum[2]}, torch::kFloat64).to(grad.color.scalar_type());
}

/// Backward pass of projection; returns the gradient of the pose.
template <typename T>
Tensor project_backward(const RasterKernels<T>& kernels, const ProjectBackwardArgs<T>& args) {
  const std::int64_t n = args.forward.count;
  std::vector<std::array<double, 6>> parts(static_cast<std::size_t>(chunk_count(n)),
                                           std::array<double, 6>{});
  for_each_task(chunk_count(n), [&](std::int64_t chunk) {
    const auto [begin, end] = chunk_range(chunk, n);
    kernels.project_backward(args, begin, end, parts[static_cast<std::size_t>(chunk)].data());
  });
  const std::array<double, 6> sum = sum_parts(parts);
  return torch::tensor(at::ArrayRef<double>(sum.data(), sum.size()), torch::kFloat64);
}

template <typename T>
RasterInputGradient backward(const RasterKernels<T>& kernels, const RasterInput& input,
                             const RasterOutput& output, const RasterOutputGradient& grad) {
  const auto state = State<T>::from(output.state);
  const auto options = input.gaussians.means.options();
  const Tensor slot_gradient = pooled_empty({state.entries.size(0), kSlotSize}, options);
  RasterInputGradient out;
  out.background = blend_backward(kernels, blend_args(input, output, state), grad, slot_gradient);
  const auto from = input.gaussians.tensors();
  const auto to = out.gaussians.tensors();
  for (std::size_t i = 0; i < to.size(); ++i) *to[i] = pooled_empty(from[i]->sizes(), options);
  out.mean2d = pooled_empty({input.gaussians.size()}, options);
  out.pose =
      project_backward<T>(kernels, {.forward = project_args<T>(input, state),
                                    .slot_begin = unsigned_data(state.slot_begin),
                                    .slot_weight = state.slot_weight.template data_ptr<T>(),
                                    .slot_gradient = slot_gradient.data_ptr<T>(),
                                    .means = out.gaussians.means.data_ptr<T>(),
                                    .log_scales = out.gaussians.log_scales.data_ptr<T>(),
                                    .quaternions = out.gaussians.quaternions.data_ptr<T>(),
                                    .logit_opacities = out.gaussians.logit_opacities.data_ptr<T>(),
                                    .sh_dc = out.gaussians.sh_dc.data_ptr<T>(),
                                    .sh_rest = out.gaussians.sh_rest.data_ptr<T>(),
                                    .mean2d = out.mean2d.data_ptr<T>()});
  return out;
}

class CpuRasterBackend final : public RasterBackend {
 public:
  CpuRasterBackend(std::string_view name, RasterKernels<float> in_float)
      : name_(name), kernels_{in_float, generic_double_kernels()} {}

  std::string_view name() const override { return name_; }

  RasterOutput forward(const RasterInput& input) const override {
    const torch::NoGradGuard no_grad;
    return AT_DISPATCH_FLOATING_TYPES(input.gaussians.means.scalar_type(), "raster_forward", [&] {
      return convert_bad_alloc(
          [&] { return gaussians::forward<scalar_t>(kernels_for<scalar_t>(kernels_), input); });
    });
  }

  RasterInputGradient backward(const RasterInput& input, const RasterOutput& output,
                               const RasterOutputGradient& grad, bool as_sparse) const override {
    TORCH_CHECK(!as_sparse, "render: the CPU backend does not support sparse gradients");
    const torch::NoGradGuard no_grad;
    return AT_DISPATCH_FLOATING_TYPES(input.gaussians.means.scalar_type(), "raster_backward", [&] {
      return convert_bad_alloc([&] {
        return gaussians::backward<scalar_t>(kernels_for<scalar_t>(kernels_), input, output, grad);
      });
    });
  }

 private:
  std::string_view name_;
  Kernels kernels_;
};

std::vector<const RasterBackend*> find_backends() {
  std::vector<const RasterBackend*> out;
#ifdef __x86_64__
  if (__builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512bw") &&
      __builtin_cpu_supports("avx512dq") && __builtin_cpu_supports("avx512vl")) {
    static const CpuRasterBackend avx512("cpu-avx512", avx512_kernels());
    out.push_back(&avx512);
  }
  if (__builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma")) {
    static const CpuRasterBackend avx2("cpu-avx2", avx2_kernels());
    out.push_back(&avx2);
  }
#endif
  static const CpuRasterBackend generic("cpu-generic", generic_float_kernels());
  out.push_back(&generic);
  return out;
}

}  // namespace

const std::vector<const RasterBackend*>& cpu_raster_backends() {
  static const std::vector<const RasterBackend*> backends = find_backends();
  return backends;
}

}  // namespace apvi::gaussians
