// SPDX-License-Identifier: BSD-3-Clause
// OpenCV's threads are not instrumented: ThreadSanitizer takes whatever they do for unordered. For
// it they stay off; those of the pipeline are what is tested.
#if defined(__SANITIZE_THREAD__)
#include <gtest/gtest.h>

#include <opencv2/core/utility.hpp>

namespace apvi {
namespace {

class OneThread : public testing::Environment {
 public:
  void SetUp() override { cv::setNumThreads(1); }
};

const testing::Environment* const one_thread =
    testing::AddGlobalTestEnvironment(new OneThread);  // GoogleTest deletes it

}  // namespace
}  // namespace apvi
#endif
