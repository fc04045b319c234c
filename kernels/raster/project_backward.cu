// SPDX-License-Identifier: BSD-3-Clause
// Backward pass from the per-pixel sums of a splat to the parameters of its Gaussian and the
// camera.
#include "kernels/raster/gaussian_loading.cuh"

namespace apvi::gaussians::cuda {
namespace {

constexpr std::uint32_t kManySlots = 16;
constexpr int kReduceThreads = 256;

__device__ void add_slot(const float* slot_weight, const float* slot_gradient, std::uint32_t slot,
                         float (&sums)[kSlotFloats]) {
  if (slot_weight[slot] == 0.0f) return;  // no contribution, so never written
  const auto* const from =
      reinterpret_cast<const float2*>(slot_gradient + std::int64_t{slot} * kSlotFloats);
  for (int k = 0; k < kSlotFloats / 2; ++k) {
    const float2 pair = from[k];
    sums[2 * k] += pair.x;
    sums[2 * k + 1] += pair.y;
  }
}

/// Sums over the slots of each thread's splat; splats with many slots are summed by the whole warp.
__device__ void add_slots(SlotRange slots, std::uint32_t capacity, const float* slot_weight,
                          const float* slot_gradient, float (&sums)[kSlotFloats]) {
  const unsigned lane = threadIdx.x % kWarp;
  for (float& x : sums) x = 0.0f;
  if (slots.begin + slots.count > capacity)
    slots.count = 0;  // capacity exceeded, to be launched again
  if (slots.count <= kManySlots) {
    for (std::uint32_t k = 0; k < slots.count; ++k) {
      add_slot(slot_weight, slot_gradient, slots.begin + k, sums);
    }
  }
  for (unsigned left = __ballot_sync(kAllLanes, slots.count > kManySlots); left != 0;
       left &= left - 1) {
    const int owner = __ffs(static_cast<int>(left)) - 1;
    const std::uint32_t begin = __shfl_sync(kAllLanes, slots.begin, owner);
    const std::uint32_t count = __shfl_sync(kAllLanes, slots.count, owner);
    float part[kSlotFloats] = {};
    for (std::uint32_t k = lane; k < count; k += kWarp) {
      add_slot(slot_weight, slot_gradient, begin + k, part);
    }
    for (int k = 0; k < kSlotFloats; ++k) {
      const float sum = warp_sum(part[k]);
      if (static_cast<int>(lane) == owner) sums[k] = sum;
    }
  }
}

/// Gradient through the view direction to mean and camera. `row` holds the SH coefficients.
struct Basis {
  float direction[3];
  float values[kMaxShRest];
};
__device__ Basis view_backward(const Frame& frame, const float* mean, const float (&color)[3],
                               const float* row, ProjectionGradient<float>& g) {
  Basis out;
  const float inverse = view_direction(frame.camera, mean, out.direction);
  const float* const direction = out.direction;
  float weights[kMaxShRest];
  sh_basis(frame.sh_degree, direction[0], direction[1], direction[2], out.values);
#pragma unroll
  for (int k = 0; k < kMaxShRest; ++k) {
    if (k >= sh_rest_used(frame.sh_degree)) break;
    weights[k] = row[3 * k] * color[0] + row[3 * k + 1] * color[1] + row[3 * k + 2] * color[2];
  }
  float grad_direction[3];
  sh_basis_backward(frame.sh_degree, direction[0], direction[1], direction[2], weights,
                    grad_direction);
  const float along = grad_direction[0] * direction[0] + grad_direction[1] * direction[1] +
                      grad_direction[2] * direction[2];
  for (int i = 0; i < 3; ++i) {
    grad_direction[i] = (grad_direction[i] - along * direction[i]) * inverse;
    g.mean[i] += grad_direction[i];
  }
  // A translation of the camera along its axes moves its center in the opposite direction.
  float shift[3];
  rotate(frame.camera.R, grad_direction, shift);
  for (int i = 0; i < 3; ++i) g.pose[i] += shift[i];
  return out;
}

/// Gradient with respect to the SH coefficients, which it overwrites in `row`.
__device__ void color_backward(const Frame& frame, const Basis& basis, const float (&color)[3],
                               float* row) {
#pragma unroll
  for (int k = 0; k < kMaxShRest; ++k) {
    if (k >= sh_rest_used(frame.sh_degree)) break;
    for (int c = 0; c < 3; ++c) row[3 * k + c] = basis.values[k] * color[c];
  }
}

/// The warp writes its threads' rows of coefficients, one row at a time.
__device__ void store_sh(const Frame& frame, int rest_count, bool wanted, std::uint32_t gaussian,
                         const float* rows, float* out) {
  const int lane = static_cast<int>(threadIdx.x) % kWarp;
  const int used = 3 * sh_rest_used(frame.sh_degree);
  for (unsigned left = __ballot_sync(kAllLanes, wanted); left != 0; left &= left - 1) {
    const int from = __ffs(static_cast<int>(left)) - 1;
    const std::int64_t row = __shfl_sync(kAllLanes, gaussian, from);
    for (int k = lane; k < used; k += kWarp) {
      out[row * 3 * rest_count + k] = rows[from * kShStride + k];
    }
  }
}

__device__ void store_tensors(const GaussianGradientPointers& out, std::int64_t i,
                              const ProjectionGradient<float>& g, const float (&color)[3],
                              float logit) {
  for (int k = 0; k < 3; ++k) {
    out.means[3 * i + k] = g.mean[k];
    out.log_scales[3 * i + k] = g.log_scale[k];
    out.sh_dc[3 * i + k] = color[k] * static_cast<float>(kSh0);
  }
  reinterpret_cast<float4*>(out.quaternions)[i] =
      make_float4(g.quaternion[0], g.quaternion[1], g.quaternion[2], g.quaternion[3]);
  out.logit_opacities[i] = logit;
}

__device__ void store_row(float4* to, const ProjectionGradient<float>& g, const float (&color)[3],
                          float logit, const float (&direction)[3]) {
  to[0] = make_float4(g.mean[0], g.mean[1], g.mean[2], g.log_scale[0]);
  to[1] = make_float4(g.log_scale[1], g.log_scale[2], g.quaternion[0], g.quaternion[1]);
  to[2] = make_float4(g.quaternion[2], g.quaternion[3], logit, color[0]);
  to[3] = make_float4(color[1], color[2], direction[0], direction[1]);
  to[4] = make_float4(direction[2], 0.0f, 0.0f, 0.0f);
}

__device__ void store_pose(const float (&pose)[kPoseScalars], float* partials) {
  __shared__ float warps[kProjectThreads / kWarp][kPoseScalars];
  const float sum = block_sums<kProjectThreads>(pose, warps);
  if (threadIdx.x < kPoseScalars) partials[blockIdx.x * kPoseScalars + threadIdx.x] = sum;
}

template <bool kRows>
__global__ void __launch_bounds__(kProjectThreads)
    project_backward_kernel(GaussianPointers in, Frame frame, SplatPointers splats,
                            const float* slot_weight, const float* max_weight,
                            BackwardScratch scratch, GaussianGradientPointers out) {
  __shared__ float coefficients[kProjectThreads * kShStride];
  float* const rows = coefficients + threadIdx.x / kWarp * kWarp * kShStride;
  float* const own_row = rows + threadIdx.x % kWarp * kShStride;
  const std::uint32_t splat = blockIdx.x * kProjectThreads + threadIdx.x;
  const bool is_splat = splat < min(splats.counts->splats, splats.capacity);
  const std::uint32_t gaussian = is_splat ? splats.gaussian[splat] : 0;
  // Half of the splats are occluded and have no gradient.
  const bool wanted = is_splat && max_weight[gaussian] > 0.0f;
  fetch_sh(in, frame.sh_degree, wanted, gaussian, rows);
  const SlotRange slots = wanted ? splats.slots[splat] : SlotRange{0, 0};
  float sums[kSlotFloats];
  add_slots(slots, splats.slot_capacity, slot_weight, scratch.slot_gradient, sums);
  __pipeline_wait_prior(0);
  __syncwarp();
  float pose[kPoseScalars] = {};
  if (wanted) {
    const ProjectedGaussian projected = project_gaussian(in, frame, gaussian);
    const FootprintGradient<float> grad_footprint =
        footprint_gradient(frame.camera, projected.f, sums, frame.antialiased);
    ProjectionGradient<float> g = project_backward(frame.camera, projected.f, grad_footprint);
    const Splat<float>& projected_splat = splats.splats[splat];
    float color[3];
    for (int c = 0; c < 3; ++c) {
      const float light = in.light != nullptr ? in.light[3 * std::int64_t{gaussian} + c] : 1.0f;
      color[c] = projected_splat.color[c] > 0.0f ? light * sums[c] : 0.0f;
    }
    Basis basis = {};
    if (frame.sh_degree > 0) basis = view_backward(frame, projected.mean, color, own_row, g);
    const float logit = sums[4] * (1.0f - projected.opacity);
    if constexpr (kRows) {
      store_row(reinterpret_cast<float4*>(out.rows + std::int64_t{splat} * kRowFloats), g, color,
                logit, basis.direction);
    } else {
      color_backward(frame, basis, color, own_row);
      store_tensors(out, gaussian, g, color, logit);
    }
    const float du = grad_footprint.u * 0.5f * static_cast<float>(frame.width);
    const float dv = grad_footprint.v * 0.5f * static_cast<float>(frame.height);
    out.mean2d[gaussian] = sqrtf(du * du + dv * dv);
    for (int k = 0; k < kPoseScalars; ++k) pose[k] = g.pose[k];
  }
  if constexpr (kRows) {
    if (is_splat && !wanted) {
      auto* const row = reinterpret_cast<float4*>(out.rows + std::int64_t{splat} * kRowFloats);
      for (int k = 0; k < kRowFloats / 4; ++k) row[k] = make_float4(0.0f, 0.0f, 0.0f, 0.0f);
    }
  } else {
    __syncwarp();
    store_sh(frame, in.sh_rest_count, wanted, gaussian, rows, out.sh_rest);
  }
  store_pose(pose, scratch.pose_partials);
}

/// One block per scalar.
__global__ void reduce_kernel(BackwardScratch scratch, int pose_rows, int background_rows) {
  __shared__ double parts[kReduceThreads];
  const bool is_pose = blockIdx.x < kPoseScalars;
  const int width = is_pose ? kPoseScalars : kBackgroundScalars;
  const int column = static_cast<int>(is_pose ? blockIdx.x : blockIdx.x - kPoseScalars);
  const float* const from = is_pose ? scratch.pose_partials : scratch.background_partials;
  double sum = 0.0;
  for (int row = static_cast<int>(threadIdx.x); row < (is_pose ? pose_rows : background_rows);
       row += kReduceThreads) {
    sum += static_cast<double>(from[row * width + column]);
  }
  parts[threadIdx.x] = sum;
  for (int by = kReduceThreads / 2; by > 0; by /= 2) {
    __syncthreads();
    if (static_cast<int>(threadIdx.x) < by) parts[threadIdx.x] += parts[threadIdx.x + by];
  }
  if (threadIdx.x == 0) scratch.sums[blockIdx.x] = parts[0];
}

}  // namespace

std::int64_t pose_partial_rows(std::uint32_t capacity) {
  return (static_cast<std::int64_t>(capacity) + kProjectThreads - 1) / kProjectThreads;
}

cudaError_t launch_project_backward(const GaussianPointers& in, const Frame& frame,
                                    const SplatPointers& splats, const float* slot_weight,
                                    const float* max_weight, const BackwardScratch& scratch,
                                    const GaussianGradientPointers& out, cudaStream_t stream) {
  const auto blocks = static_cast<unsigned>(pose_partial_rows(splats.capacity));
  const auto kernel =
      out.rows != nullptr ? project_backward_kernel<true> : project_backward_kernel<false>;
  kernel<<<blocks, kProjectThreads, 0, stream>>>(in, frame, splats, slot_weight, max_weight,
                                                 scratch, out);
  reduce_kernel<<<kPoseScalars + kBackgroundScalars, kReduceThreads, 0, stream>>>(
      scratch, static_cast<int>(blocks), frame.tiles() * kTileWarps);
  return cudaGetLastError();
}

}  // namespace apvi::gaussians::cuda
