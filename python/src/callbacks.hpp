// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <functional>
#include <memory>
#include <utility>

#include "bindings.hpp"

namespace apvi::python {

/// A Python function that C++ threads, which do not hold Python's global lock, may copy, call and
/// destroy. `Convert` makes its arguments, a tuple, while the lock is held.
template <typename Argument, typename Convert>
std::function<void(const Argument&)> callback(const py::object& function, const Convert& convert) {
  if (function.is_none()) return {};
  const auto destroy = [](PyObject* held) {
    const py::gil_scoped_acquire acquire;
    Py_DECREF(held);
  };
  const std::shared_ptr<PyObject> held(function.inc_ref().ptr(), destroy);
  return [held, convert](const Argument& argument) {
    const py::gil_scoped_acquire acquire;
    py::handle(held.get())(*convert(argument));
  };
}

}  // namespace apvi::python
