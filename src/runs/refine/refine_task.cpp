// SPDX-License-Identifier: BSD-3-Clause
#include "runs/refine/refine_task.hpp"

#include <torch/torch.h>

#include <algorithm>
#include <set>
#include <system_error>
#include <utility>
#include <vector>

#include "core/stopwatch.hpp"
#include "gaussians/model/rows.hpp"
#include "mapping/training/trainer.hpp"
#include "runs/refine/refine_input.hpp"
#include "runs/refine/refine_options.hpp"
#include "runs/refine/refine_result.hpp"

namespace apvi::runs {
namespace {

namespace fs = std::filesystem;
using torch::Tensor;

constexpr double kCheckpointInterval_s = 60.0;

/// Steps of a task; those of all rounds together are `steps_per_image` for each image.
int steps_of(const RefinePlan& plan, const RefineTask& task) {
  const auto images =
      static_cast<std::int64_t>(plan.blocks.at(static_cast<std::size_t>(task.block)).images.size());
  const std::int64_t all = images * plan.steps_per_image;
  return static_cast<int>(all * (task.round + 1) / plan.rounds - all * task.round / plan.rounds);
}

mapping::TrainerOptions options_of(const RefineInput& input, const RefinePlan& plan,
                                   const RefineTask& task) {
  mapping::TrainerOptions options =
      refine_options(input.config, input.images, plan.tone_curve, steps_of(plan, task));
  options.schedule_start = static_cast<double>(task.round) / plan.rounds;
  options.schedule_end = static_cast<double>(task.round + 1) / plan.rounds;
  options.densify.max_gaussians = plan.max_gaussians;
  // The water is that of the whole map, the same in all blocks.
  options.medium_estimation = mapping::MediumEstimationMethod::gradient;
  options.seed += static_cast<std::uint64_t>(task.round * plan.partition.size() + task.block);
  return options;
}

/// Indices of the images that the block owns.
std::vector<std::int64_t> owned_images(const RefinePlan& plan, const RefineTask& task,
                                       const mapping::KeyframeStore& store) {
  std::set<std::int64_t> owned;
  for (const RefineImage& image : plan.images) {
    if (image.owner == task.block) owned.insert(image.image.ns);
  }
  std::vector<std::int64_t> indices;
  for (std::size_t i = 0; i < store.size(); ++i) {
    if (owned.contains(store[i].stamp_ns)) indices.push_back(static_cast<std::int64_t>(i));
  }
  return indices;
}

/// The training of a block.
class BlockTraining {
 public:
  BlockTraining(const fs::path& folder, const RefinePlan& plan, const RefineTask& task,
                ImageCache& images)
      : folder_(folder),
        plan_(plan),
        task_(task),
        input_(load_refine_input(folder, plan, task, images)),
        trainer_({{.keyframes = &input_.images.store,
                   .options = options_of(input_, plan, task),
                   .medium = input_.medium,
                   .response = input_.response}},
                 input_.gaussians) {
    input_.gaussians = {};  // the trainer has its own
    if (fs::exists(checkpoint())) trainer_.resume(checkpoint());
  }

  /// False when it was interrupted.
  bool run(const RefineTaskHooks& hooks) {
    Stopwatch since_checkpoint;
    const double steps = std::max(1, steps_of(plan_, task_));
    while (!trainer_.done()) {
      trainer_.step();
      hooks.progress(static_cast<double>(trainer_.iteration()) / steps);
      const bool interrupted = hooks.interrupted();
      if (interrupted || since_checkpoint.seconds() > kCheckpointInterval_s) {
        trainer_.save(checkpoint());
        since_checkpoint.reset();
      }
      if (interrupted) return false;
    }
    return true;
  }

  void write() const {
    const torch::NoGradGuard no_grad;
    write_result(result_file(folder_, task_), result());
    std::error_code ignored;
    fs::remove(checkpoint(), ignored);
  }

 private:
  fs::path checkpoint() const { return task_file(folder_, task_, ".checkpoint.pt"); }

  RefineResult result() const {
    const mapping::Map map = trainer_.full_map();
    const mapping::KeyframeStore& store = input_.images.store;
    const Tensor own = plan_.partition.block_of(map.gaussians.means) == task_.block;
    RefineResult result{
        .gaussians = gaussians::on_device(
            gaussians::select(map.gaussians, own.nonzero().squeeze(1)), torch::kCPU)};
    const std::vector<std::int64_t> images = owned_images(plan_, task_, store);
    std::vector<Tensor> poses = {torch::empty({0, 4, 4}, torch::kFloat64)};
    for (const std::int64_t i : images) {
      const auto index = static_cast<std::size_t>(i);
      const Tensor delta = trainer_.corrections().pose_delta(index, /*learn=*/false);
      result.stamps_ns.push_back(store[index].stamp_ns);
      poses.push_back(mapping::corrected_pose(store[index].T_camera_world, delta).unsqueeze(0));
    }
    const Tensor index = torch::tensor(images, torch::kInt64);
    result.poses = torch::cat(poses);
    result.log_gains = map.log_gains.defined() ? map.log_gains.cpu().index_select(0, index)
                                               : torch::zeros({index.size(0)});
    if (map.illumination.defined()) {
      result.illumination = map.illumination.cpu().index_select(0, index);
    }
    result.steps = input_.steps + trainer_.iteration();
    result.seconds = input_.seconds + trainer_.seconds();
    return result;
  }

  const fs::path& folder_;
  const RefinePlan& plan_;
  RefineTask task_;
  RefineInput input_;
  mapping::Trainer trainer_;
};

}  // namespace

bool run_task(const fs::path& folder, const RefinePlan& plan, const RefineTask& task,
              ImageCache& images, const RefineTaskHooks& hooks) {
  BlockTraining training(folder, plan, task, images);
  if (!training.run(hooks)) return false;
  training.write();
  return true;
}

}  // namespace apvi::runs
