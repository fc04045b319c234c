// SPDX-License-Identifier: BSD-3-Clause
#pragma once

/// Compiles a function, and what is inlined into it, for several instruction sets; one is picked
/// when the program is loaded. All but the first have fused multiply-add, so the last bits differ
/// from one kind of processor to another, never from one run to another.
#if defined(__x86_64__) && defined(__GNUC__) && !defined(__clang__) && !defined(__SANITIZE_THREAD__)
#define APVI_CPU_CLONES __attribute__((target_clones("avx512f", "fma", "default")))
#else
#define APVI_CPU_CLONES
#endif
/// For templates that every clone must have its own copy of.
#define APVI_INLINE __attribute__((always_inline)) inline
