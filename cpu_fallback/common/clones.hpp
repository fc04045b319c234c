// SPDX-License-Identifier: BSD-3-Clause
#pragma once

/// Compiles a function, including what is inlined into it, for several instruction sets; one is
/// selected at load time. All but the default use fused multiply-add, so the last bits may differ
/// between processors, never between runs.
#if defined(__x86_64__) && defined(__GNUC__) && !defined(__clang__) && !defined(__SANITIZE_THREAD__)
#define APVI_CPU_CLONES __attribute__((target_clones("avx512f", "fma", "default")))
#else
#define APVI_CPU_CLONES
#endif
/// For templates that must be inlined into every clone.
#define APVI_INLINE __attribute__((always_inline)) inline
