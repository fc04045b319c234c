// SPDX-License-Identifier: BSD-3-Clause
#pragma once

/// Compiles a function for several instruction sets and selects one at load time. Disabled for the
/// thread sanitizer, which does not support the ifunc resolver, and for clang.
#if defined(__x86_64__) && defined(__GNUC__) && !defined(__clang__) && !defined(__SANITIZE_THREAD__)
#define APVI_CLONES __attribute__((target_clones("avx512f", "avx2", "default")))
#else
#define APVI_CLONES
#endif
