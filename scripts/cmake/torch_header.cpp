// SPDX-License-Identifier: BSD-3-Clause
// Nothing: the target of this file owns the precompiled header of LibTorch that the others share.
