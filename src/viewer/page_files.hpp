// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string_view>

namespace apvi::viewer {

/// Content of a file of `page/`, which is compiled in; empty: there is none of that name.
std::string_view page_file(std::string_view name);

}  // namespace apvi::viewer
