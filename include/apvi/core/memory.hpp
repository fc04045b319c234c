// SPDX-License-Identifier: BSD-3-Clause
#pragma once

namespace apvi {

/// The most memory that this process has had resident so far [MiB].
double peak_memory_mib();

}  // namespace apvi
