# SPDX-License-Identifier: BSD-3-Clause
"""Keeps two different LibTorch libraries out of one process.

LibTorch's dispatcher is a unique symbol (STB_GNU_UNIQUE): the dynamic loader gives it to every library in the
process once, whatever the visibility, so a second LibTorch would register its operators with the first one and
terminate the process. The Python package `torch` brings its own LibTorch. If that is not the one that this package
was built with, only one of the two packages can be imported; the second import raises ImportError.
"""
from __future__ import annotations

import importlib.abc
import importlib.machinery
import os
import pathlib
import re
import sys
from collections.abc import Sequence
from types import ModuleType

from ._build_info import LIBTORCH, TORCH_VERSION

REMEDY = ("use them in two processes, or build apvi with the LibTorch of this torch package: "
          "pip install SOURCE --config-settings=cmake.define.CMAKE_PREFIX_PATH={folder}")


def version_of(folder: pathlib.Path) -> str:
    """The version of the torch package in this folder, without what follows a plus sign; empty if unknown."""
    try:
        text = (folder / "version.py").read_text(encoding="utf-8")
    except OSError:
        return ""
    match = re.search(r"__version__\s*=\s*['\"]([^'\"+]+)", text)
    return match.group(1) if match else ""


def conflict(folder: pathlib.Path) -> str | None:
    """Why the torch package in this folder cannot be in the process with this one, or None."""
    theirs = folder / "lib" / "libtorch_cpu.so"
    if not theirs.exists() or (os.path.exists(LIBTORCH) and os.path.samefile(theirs, LIBTORCH)):
        return None
    # Libraries of equal names are loaded once, from whichever package comes first.
    if os.path.basename(os.path.realpath(LIBTORCH)) == theirs.name and version_of(folder) == TORCH_VERSION:
        return None
    return (f"apvi was built with LibTorch {TORCH_VERSION} ({LIBTORCH}), but torch {version_of(folder)} in {folder} "
            f"has its own: {REMEDY.format(folder=folder)}")


def folder_of(spec: importlib.machinery.ModuleSpec | None) -> pathlib.Path | None:
    return pathlib.Path(spec.origin).parent if spec is not None and spec.origin else None


class RefusingLoader(importlib.abc.Loader):
    """Raises ImportError when the module is imported, but not when it is only looked for."""

    def __init__(self, reason: str) -> None:
        self.reason = reason

    def exec_module(self, module: ModuleType) -> None:
        raise ImportError(self.reason, name=module.__name__)


class TorchGuard(importlib.abc.MetaPathFinder):
    """Refuses a later `import torch` of a package with another LibTorch."""

    def find_spec(self, fullname: str, path: Sequence[str] | None,
                  target: ModuleType | None = None) -> importlib.machinery.ModuleSpec | None:
        if fullname != "torch":
            return None
        spec = importlib.machinery.PathFinder.find_spec(fullname, path)
        folder = folder_of(spec)
        reason = conflict(folder) if spec and folder else None
        if not spec or not reason:
            return None  # the usual finders go on
        return importlib.machinery.ModuleSpec(fullname, RefusingLoader(reason), origin=spec.origin)


def prepare() -> None:
    """Before the extension module is loaded. Raises ImportError if a torch package with another LibTorch is."""
    loaded = sys.modules.get("torch")
    if loaded is not None:
        folder = folder_of(loaded.__spec__)
        reason = conflict(folder) if folder else None
        if reason:
            raise ImportError(reason, name="apvi")
    elif not any(isinstance(finder, TorchGuard) for finder in sys.meta_path):
        sys.meta_path.insert(0, TorchGuard())
