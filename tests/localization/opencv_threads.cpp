// SPDX-License-Identifier: BSD-3-Clause
// OpenCV is not instrumented, so ThreadSanitizer reports false races in its threads: disables them.
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
