// SPDX-License-Identifier: BSD-3-Clause
// Control flow and memory of the GPU rasterizer.
#include <ATen/cuda/CUDAContext.h>
#include <ATen/cuda/CUDAEvent.h>
#include <c10/cuda/CUDAException.h>
#include <c10/cuda/CUDAGuard.h>
#include <torch/torch.h>

#include <algorithm>

#include "gaussians/render/camera.hpp"
#include "gaussians/render/raster_backend.hpp"
#include "kernels/raster/raster.hpp"

namespace apvi::gaussians {
namespace {

using torch::Tensor;

/// Numbers of splats and slots of the thread's last image, and the buffer that receives those of
/// the next. Consecutive images of a map need similar amounts.
struct RasterMemory {
  cuda::Counts last = {0, 0};
  Tensor host_counts = torch::empty({2}, torch::dtype(torch::kInt32).pinned_memory(true));
  at::cuda::CUDAEvent counted;
  at::cuda::CUDAEvent projected, listed, prepared;

  cuda::Counts* counts() {
    return reinterpret_cast<cuda::Counts*>(host_counts.data_ptr<std::int32_t>());
  }
};
RasterMemory& raster_memory() {
  static thread_local RasterMemory memory;
  return memory;
}

/// Capacity with some slack.
std::uint32_t with_slack(std::uint32_t count) {
  return count + count / 8 + 1024;
}

/// Lays out parts of one allocation, each aligned to 256 bytes.
class Parts {
 public:
  std::int64_t take(std::int64_t bytes) {
    const std::int64_t at = size_;
    size_ += (bytes + 255) / 256 * 256;
    return at;
  }
  std::int64_t size() const { return size_; }

 private:
  std::int64_t size_ = 0;
};

cuda::GaussianPointers to_pointers(const RasterInput& input) {
  const Gaussians& g = input.gaussians;
  return {.count = g.size(),
          .means = g.means.data_ptr<float>(),
          .log_scales = g.log_scales.data_ptr<float>(),
          .quaternions = g.quaternions.data_ptr<float>(),
          .logit_opacities = g.logit_opacities.data_ptr<float>(),
          .sh_dc = g.sh_dc.data_ptr<float>(),
          .sh_rest = g.sh_rest.data_ptr<float>(),
          .light = input.light.defined() ? input.light.data_ptr<float>() : nullptr,
          .sh_rest_count = static_cast<int>(g.sh_rest.size(1))};
}

cuda::Frame to_frame(const RasterInput& input) {
  return {.camera = make_camera<float>(input.T_camera_world.data_ptr<double>(), input.intrinsics,
                                       input.near_m, input.low_pass_px2),
          .width = input.intrinsics.width,
          .height = input.intrinsics.height,
          .sh_degree = input.sh_degree,
          .antialiased = input.antialiased};
}

/// Memory saved for the backward pass; less with `images_only`.
class RasterBuffers {
 public:
  RasterBuffers(const cuda::Counts& capacity, const cuda::Frame& frame, const RasterInput& input)
      : capacity_(capacity),
        frame_(frame),
        images_only_(input.images_only),
        layout_(capacity, frame.tiles(), images_only_) {
    const auto options = input.gaussians.means.options();
    memory_ = torch::empty({layout_.parts.size()}, options.dtype(torch::kUInt8));
    if (!images_only_) {
      row_ = torch::empty({input.gaussians.size()}, options.dtype(torch::kInt32));
    }
  }
  RasterBuffers(const RasterState& state, const cuda::Frame& frame)
      : capacity_{static_cast<std::uint32_t>(state[1].data_ptr<std::int64_t>()[0]),
                  static_cast<std::uint32_t>(state[1].data_ptr<std::int64_t>()[1])},
        frame_(frame),
        images_only_(false),
        layout_(capacity_, frame.tiles(), images_only_),
        memory_(state[0]),
        row_(state[2]) {}

  RasterState state() const {
    return {memory_,
            torch::tensor({static_cast<std::int64_t>(capacity_.splats),
                           static_cast<std::int64_t>(capacity_.slots)}),
            row_};
  }
  /// [N] int32: splat index of a Gaussian; -1: none.
  const Tensor& row() const { return row_; }
  cuda::SplatPointers splats() const {
    return {.capacity = capacity_.splats,
            .slot_capacity = capacity_.slots,
            .splats = at<Splat<float>>(layout_.splats),
            .gaussian = at<std::uint32_t>(layout_.gaussian),
            .slots = at<cuda::SlotRange>(layout_.slots),
            .depth_keys = nullptr,
            .block_state = nullptr,
            .counts = at<cuda::Counts>(layout_.counts),
            .host_counts = nullptr};
  }
  cuda::BinPointers bins() const {
    return {.slot_splat = nullptr,
            .tile_slots = at<std::uint32_t>(layout_.tile_slots),
            .tile_draws = kept<std::uint32_t>(layout_.tile_draws),
            .tile_begin = at<std::uint32_t>(layout_.tile_begin),
            .chunk_slots = cuda::chunk_slots(capacity_.slots),
            .chunk_begin = at<std::uint32_t>(layout_.chunk_begin),
            .chunk_tile = at<std::uint32_t>(layout_.chunk_tile),
            .chunk_draw_count = kept<std::uint32_t>(layout_.chunk_draw_count),
            .chunk_order = at<std::uint32_t>(layout_.chunk_order),
            .last_visible_chunk = at<std::uint32_t>(layout_.last_visible_chunk),
            .drawing = {},
            .state = nullptr,
            .scratch = nullptr};
  }
  cuda::ChunkPointers chunks() const {
    return {.transmittance = nullptr,
            .start = kept<float2>(layout_.start),
            .end = nullptr,
            .sums = at<float4>(layout_.sums)};
  }
  float* slot_weight() const { return kept<float>(layout_.slot_weight); }
  const cuda::Frame& frame() const { return frame_; }
  const cuda::Counts& capacity() const { return capacity_; }

 private:
  struct Layout {
    Parts parts;
    std::int64_t splats, gaussian, slots, counts, tile_slots, tile_draws, tile_begin, slot_weight;
    std::int64_t chunk_begin, chunk_tile, chunk_draw_count, chunk_order, last_visible_chunk, start,
        sums;

    Layout(const cuda::Counts& n, int tiles, bool images_only)
        : splats(parts.take(std::int64_t{n.splats} * 64)),
          gaussian(parts.take(std::int64_t{n.splats} * 4)),
          slots(parts.take(std::int64_t{n.splats} * 8)),
          counts(parts.take(8)),
          tile_slots(parts.take(std::int64_t{n.slots} * 4)),
          tile_draws(parts.take(images_only ? 0 : std::int64_t{n.slots} * 4)),
          tile_begin(parts.take((std::int64_t{tiles} + 1) * 4)),
          slot_weight(parts.take(images_only ? 0 : std::int64_t{n.slots} * 4)),
          chunk_begin(parts.take((std::int64_t{tiles} + 1) * 4)),
          chunk_tile(parts.take(chunks(n, tiles) * 4)),
          chunk_draw_count(parts.take(images_only ? 0 : chunks(n, tiles) * 4)),
          chunk_order(parts.take(chunks(n, tiles) * 4)),
          last_visible_chunk(parts.take(std::int64_t{tiles} * 4)),
          start(parts.take(images_only ? 0 : chunks(n, tiles) * cuda::kTilePixels * 4)),
          sums(parts.take(chunks(n, tiles) * cuda::kTilePixels * 16)) {}

    static std::int64_t chunks(const cuda::Counts& n, int tiles) {
      return cuda::chunk_capacity(n.slots, cuda::chunk_slots(n.slots), tiles);
    }
  };

  template <typename P>
  P* at(std::int64_t offset) const {
    return reinterpret_cast<P*>(memory_.data_ptr<std::uint8_t>() + offset);
  }

  template <typename P>
  P* kept(std::int64_t offset) const {
    return images_only_ ? nullptr : at<P>(offset);
  }

  cuda::Counts capacity_;
  cuda::Frame frame_;
  bool images_only_;
  Layout layout_;
  Tensor memory_;
  Tensor row_;
};

/// Scratch memory of the forward pass.
class Scratch {
 public:
  Scratch(const RasterInput& input, const cuda::Counts& capacity, const cuda::Frame& frame,
          std::uint32_t chunk_slots)
      : images_only_(input.images_only) {
    const std::int64_t chunks = cuda::chunk_capacity(capacity.slots, chunk_slots, frame.tiles());
    const auto take_bytes = [&](std::size_t bytes) {
      return parts_.take(static_cast<std::int64_t>(bytes));
    };
    block_state_ = parts_.take((cuda::project_blocks(input.gaussians.size()) + 1) * 8);
    bin_state_ = take_bytes(cuda::bin_state_bytes(capacity.splats, capacity.slots, frame));
    depth_keys_ = parts_.take(std::int64_t{capacity.splats} * 4);
    slot_splat_ = parts_.take(images_only_ ? 0 : std::int64_t{capacity.slots} * 4);
    started_ = parts_.take(4);
    kinds_ = parts_.take(cuda::kChunkKinds * 4);
    finished_ = parts_.take(std::int64_t{frame.tiles()} * 4);
    ready_ = parts_.take(chunks * 4);
    transmittance_ = parts_.take(chunks * cuda::kTilePixels * 4);
    end_ = parts_.take(chunks * cuda::kTilePixels * 4);
    bin_ = take_bytes(cuda::bin_scratch_bytes(capacity.splats, capacity.slots, frame.tiles()));
    memory_ = torch::empty({parts_.size()}, input.gaussians.means.options().dtype(torch::kUInt8));
  }

  /// Zero-initializes the states.
  void clear(cudaStream_t stream) const {
    C10_CUDA_CHECK(cudaMemsetAsync(at<char>(block_state_), 0,
                                   static_cast<std::size_t>(depth_keys_ - block_state_), stream));
  }

  void set_pointers(cuda::SplatPointers& splats, cuda::BinPointers& bins,
                    cuda::ChunkPointers& chunks) const {
    splats.block_state = at<unsigned long long>(block_state_);
    splats.depth_keys = at<std::uint32_t>(depth_keys_);
    bins.slot_splat = images_only_ ? nullptr : at<std::uint32_t>(slot_splat_);
    bins.drawing = {.started = at<std::uint32_t>(started_),
                    .kinds = at<std::uint32_t>(kinds_),
                    .finished = at<std::uint32_t>(finished_),
                    .ready = at<std::uint32_t>(ready_)};
    bins.state = at<char>(bin_state_);
    bins.scratch = at<char>(bin_);
    chunks.transmittance = at<float2>(transmittance_);
    chunks.end = at<float2>(end_);
  }

 private:
  template <typename P>
  P* at(std::int64_t offset) const {
    return reinterpret_cast<P*>(memory_.data_ptr<std::uint8_t>() + offset);
  }

  bool images_only_;
  Parts parts_;
  std::int64_t block_state_, bin_state_, depth_keys_, slot_splat_, started_, kinds_, finished_,
      ready_, transmittance_, end_, bin_;
  Tensor memory_;
};

cuda::StatisticsPointers to_pointers(const RasterOutput& out, const Tensor& row) {
  if (!row.defined()) return {};
  return {.visible = out.visible.data_ptr<bool>(),
          .radii_px = out.radii_px.data_ptr<float>(),
          .max_weight = out.max_weight.data_ptr<float>(),
          .row = row.data_ptr<std::int32_t>()};
}

/// Launches the whole forward pass for a capacity; the counts arrive in `memory` asynchronously.
RasterBuffers launch_forward(const RasterInput& input, const RasterOutput& out,
                             const cuda::Counts& capacity, RasterMemory& memory) {
  const auto stream = at::cuda::getCurrentCUDAStream();
  const cuda::GaussianPointers gaussians = to_pointers(input);
  RasterBuffers buffers(capacity, to_frame(input), input);
  const cuda::Frame& frame = buffers.frame();
  cuda::SplatPointers splats = buffers.splats();
  cuda::BinPointers bins = buffers.bins();
  cuda::ChunkPointers chunks = buffers.chunks();
  const Scratch scratch(input, capacity, frame, bins.chunk_slots);
  scratch.clear(stream);
  scratch.set_pointers(splats, bins, chunks);
  splats.host_counts = memory.counts();
  const cuda::StatisticsPointers statistics = to_pointers(out, buffers.row());
  C10_CUDA_CHECK(cuda::launch_project(gaussians, frame, splats, statistics, stream));
  memory.counted.record(stream);
  // Sorting occupies few multiprocessors; only blending waits for colors and chunks.
  const auto other = at::cuda::getStreamFromPool(false, stream.device_index());
  memory.projected.record(stream);
  memory.projected.block(other);
  C10_CUDA_CHECK(cuda::launch_shade(gaussians, frame, splats, statistics, other));
  C10_CUDA_CHECK(cuda::launch_list(frame, splats, bins, stream));
  memory.listed.record(stream);
  memory.listed.block(other);
  C10_CUDA_CHECK(cuda::launch_place_chunks(frame, bins, other));
  memory.prepared.record(other);
  C10_CUDA_CHECK(cuda::launch_sort(frame, splats, bins, stream));
  memory.prepared.block(stream);
  const cuda::ImagePointers image = {.background = input.background.data_ptr<float>(),
                                     .color = out.color.data_ptr<float>(),
                                     .depth = out.depth.data_ptr<float>(),
                                     .alpha = out.alpha.data_ptr<float>()};
  C10_CUDA_CHECK(cuda::launch_blend(frame, splats, bins, image, chunks, buffers.slot_weight(),
                                    statistics, stream));
  return buffers;
}

RasterOutput empty_output(const RasterInput& input) {
  const auto options = input.gaussians.means.options();
  const std::int64_t n = input.gaussians.size();
  const std::int64_t height = input.intrinsics.height;
  const std::int64_t width = input.intrinsics.width;
  RasterOutput out = {.color = torch::empty({height, width, 3}, options),
                      .depth = torch::empty({height, width}, options),
                      .alpha = torch::empty({height, width}, options),
                      .visible = {},
                      .radii_px = {},
                      .max_weight = {},
                      .state = {}};
  if (input.images_only) return out;
  out.visible = torch::empty({n}, options.dtype(torch::kBool));
  out.radii_px = torch::empty({n}, options);
  out.max_weight = torch::empty({n}, options);
  return out;
}

/// Zero gradients in one allocation, cleared at once.
Gaussians zero_gradients(const Gaussians& like, Tensor& mean2d) {
  const auto from = like.tensors();
  std::int64_t values = like.size() + 4;
  for (const Tensor* tensor : from) values += (tensor->numel() + 3) / 4 * 4;
  const Tensor all = torch::zeros({values}, like.means.options());
  Gaussians out;
  const auto to = out.tensors();
  std::int64_t at = 0;
  for (std::size_t k = 0; k < to.size(); ++k) {
    *to[k] = all.narrow(0, at, from[k]->numel()).view(from[k]->sizes());
    at += (from[k]->numel() + 3) / 4 * 4;  // aligned for vectorized access
  }
  mean2d = all.narrow(0, at, like.size());
  return out;
}

class CudaRasterBackend final : public RasterBackend {
 public:
  std::string_view name() const override { return "cuda"; }

  /// Launches everything with slightly more capacity than the last image needed; reads the counts
  /// while the device is busy, and repeats only if the capacity was exceeded.
  RasterOutput forward(const RasterInput& input) const override {
    const torch::NoGradGuard no_grad;
    const c10::cuda::CUDAGuard guard(input.gaussians.means.device());
    const std::int64_t n = input.gaussians.size();
    RasterOutput out = empty_output(input);
    RasterMemory& memory = raster_memory();
    while (true) {
      const cuda::Counts capacity = {
          static_cast<std::uint32_t>(std::min<std::int64_t>(with_slack(memory.last.splats), n + 1)),
          with_slack(memory.last.slots)};
      const RasterBuffers buffers = launch_forward(input, out, capacity, memory);
      memory.counted.synchronize();
      memory.last = *memory.counts();
      TORCH_CHECK(memory.last.splats < (1U << cuda::kSplatBits) && memory.last.slots < (1U << 30U),
                  "render: ", memory.last.splats, " Gaussians touch ", memory.last.slots,
                  " tiles, too many to sort");
      if (memory.last.splats > capacity.splats || memory.last.slots > capacity.slots) continue;
      if (!input.images_only) out.state = buffers.state();
      return out;
    }
  }

  bool has_sparse_gradient() const override { return true; }

  RasterInputGradient backward(const RasterInput& input, const RasterOutput& output,
                               const RasterOutputGradient& grad, bool as_sparse) const override {
    const torch::NoGradGuard no_grad;
    const c10::cuda::CUDAGuard guard(input.gaussians.means.device());
    const auto stream = at::cuda::getCurrentCUDAStream();
    const auto options = input.gaussians.means.options();
    const RasterBuffers buffers(output.state, to_frame(input));
    const cuda::Frame& frame = buffers.frame();
    const cuda::Counts& capacity = buffers.capacity();
    const Tensor slot_gradient =
        torch::empty({std::int64_t{capacity.slots} * cuda::kSlotFloats}, options);
    const Tensor partials =
        torch::empty({std::int64_t{frame.tiles()} * cuda::kTileWarps * cuda::kBackgroundScalars +
                      cuda::pose_partial_rows(capacity.splats) * cuda::kPoseScalars},
                     options);
    const Tensor sums = torch::empty({cuda::kPoseScalars + cuda::kBackgroundScalars},
                                     options.dtype(torch::kFloat64));
    const cuda::BackwardScratch scratch = {
        .slot_gradient = slot_gradient.data_ptr<float>(),
        .background_partials = partials.data_ptr<float>(),
        .pose_partials = partials.data_ptr<float>() +
                         std::int64_t{frame.tiles()} * cuda::kTileWarps * cuda::kBackgroundScalars,
        .sums = sums.data_ptr<double>()};
    const cuda::ImagePointers image = {.background = input.background.data_ptr<float>(),
                                       .color = output.color.data_ptr<float>(),
                                       .depth = output.depth.data_ptr<float>(),
                                       .alpha = output.alpha.data_ptr<float>()};
    const cuda::ImageGradientPointers image_grad = {
        .color = grad.color.data_ptr<float>(),
        .depth = grad.depth.defined() ? grad.depth.data_ptr<float>() : nullptr,
        .alpha = grad.alpha.defined() ? grad.alpha.data_ptr<float>() : nullptr};
    C10_CUDA_CHECK(cuda::launch_blend_backward(frame, buffers.splats(), buffers.bins(), image,
                                               buffers.chunks(), image_grad, scratch, stream));
    RasterInputGradient out;
    const cuda::GaussianGradientPointers to =
        as_sparse ? make_sparse(input, buffers, out) : make_dense(input.gaussians, out);
    C10_CUDA_CHECK(cuda::launch_project_backward(
        to_pointers(input), frame, buffers.splats(), buffers.slot_weight(),
        output.max_weight.data_ptr<float>(), scratch, to, stream));
    out.pose = sums.narrow(0, 0, cuda::kPoseScalars);
    out.background = sums.narrow(0, cuda::kPoseScalars, cuda::kBackgroundScalars).to(options);
    return out;
  }

 private:
  static cuda::GaussianGradientPointers make_sparse(const RasterInput& input,
                                                    const RasterBuffers& buffers,
                                                    RasterInputGradient& out) {
    const auto options = input.gaussians.means.options();
    out.sparse = {.row = buffers.row(),
                  .values = torch::empty(
                      {std::int64_t{buffers.capacity().splats}, cuda::kRowFloats}, options),
                  .sh_degree = input.sh_degree};
    out.mean2d = torch::zeros({input.gaussians.size()}, options);
    cuda::GaussianGradientPointers to = {};
    to.rows = out.sparse.values.data_ptr<float>();
    to.mean2d = out.mean2d.data_ptr<float>();
    return to;
  }

  static cuda::GaussianGradientPointers make_dense(const Gaussians& gaussians,
                                                   RasterInputGradient& out) {
    out.gaussians = zero_gradients(gaussians, out.mean2d);
    return {.rows = nullptr,
            .means = out.gaussians.means.data_ptr<float>(),
            .log_scales = out.gaussians.log_scales.data_ptr<float>(),
            .quaternions = out.gaussians.quaternions.data_ptr<float>(),
            .logit_opacities = out.gaussians.logit_opacities.data_ptr<float>(),
            .sh_dc = out.gaussians.sh_dc.data_ptr<float>(),
            .sh_rest = out.gaussians.sh_rest.data_ptr<float>(),
            .mean2d = out.mean2d.data_ptr<float>()};
  }
};

}  // namespace

const RasterBackend& cuda_raster_backend() {
  static const CudaRasterBackend backend;
  return backend;
}

}  // namespace apvi::gaussians
