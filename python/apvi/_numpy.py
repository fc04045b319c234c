# SPDX-License-Identifier: BSD-3-Clause
"""Refuses a NumPy whose arrays the extension module would read wrongly.

NumPy 2 changed the layout of its types; pybind11 knows it from version 2.12 on. Debian 12 has pybind11 2.10.
"""
from __future__ import annotations

from ._build_info import PYBIND11_VERSION


def numbers(version: str) -> tuple[int, int]:
    """Major and minor version."""
    major, minor = version.split(".")[:2]
    return int(major), int(minor)


def conflict(numpy_version: str, pybind11_version: str = PYBIND11_VERSION) -> str | None:
    """Why the extension module cannot be used with this NumPy, or None."""
    if numbers(numpy_version) < (2, 0) or numbers(pybind11_version) >= (2, 12):
        return None
    return (f"apvi was built with pybind11 {pybind11_version}, which does not know NumPy {numpy_version}: install "
            "\"numpy<2\", or build apvi with pip install, which takes a newer pybind11")


def prepare() -> None:
    """Before the extension module is loaded. Raises ImportError."""
    import numpy
    reason = conflict(numpy.__version__)
    if reason:
        raise ImportError(reason, name="apvi")
