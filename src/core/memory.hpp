// SPDX-License-Identifier: BSD-3-Clause
#pragma once

namespace apvi {

/// Peak resident set size of this process [MiB].
double peak_memory_mib();

}  // namespace apvi
