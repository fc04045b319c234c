// SPDX-License-Identifier: BSD-3-Clause
#include <pybind11/stl.h>
#include <pybind11/stl/filesystem.h>

#include <memory>

#include "apvi/io/live_sequence.hpp"
#include "apvi/io/sequence.hpp"
#include "bindings.hpp"
#include "options.hpp"
#include "rig.hpp"

namespace apvi::python {
namespace {

/// A recording with the calibration that its configuration makes of it.
class Recording {
 public:
  Recording(const std::filesystem::path& path, const Options& options) : config_(options.config) {
    const py::gil_scoped_release release;
    config_.dataset.path = path.string();
    reader_ = io::open_sequence(config_.dataset, config_.sensors.use);
  }

  io::SequenceReader& reader() const { return *reader_; }
  RigFile rig() const { return RigFile(runs::resolve_rig(config_, reader_->rig())); }

 private:
  runs::RunConfig config_;
  std::unique_ptr<io::SequenceReader> reader_;
};

SensorEvent next(io::SequenceReader& reader) {
  std::optional<SensorEvent> event;
  {
    const py::gil_scoped_release release;
    event = reader.next();
  }
  if (!event) throw py::stop_iteration();
  return std::move(*event);
}

py::dict report(const io::SequenceReader& reader) {
  py::dict out;
  for (const auto& [sensor, stream] : reader.report()) {
    py::dict dropped;
    for (const auto& [reason, count] : stream.dropped) dropped[py::str(to_string(reason))] = count;
    py::dict counts;
    counts["delivered"] = stream.delivered;
    counts["dropped"] = dropped;
    out[py::str(sensor)] = counts;
  }
  return out;
}

std::unique_ptr<io::LiveSequence> make_live(const RigFile& rig, std::size_t capacity,
                                            double reorder_s) {
  const io::LiveOptions options{.capacity = capacity, .reorder_s = reorder_s};
  return std::make_unique<io::LiveSequence>(rig.node, options);
}

void bind_recording(py::module_& m) {
  py::class_<Recording>(m, "Recording", "Samples of a recording in order of time; an iterator.")
      .def(py::init<const std::filesystem::path&, const Options&>(), py::arg("path"),
           py::arg("options") = Options(),
           "A folder, .bag, .mcap or .db3. Uses the sections dataset, rig and sensors.")
      .def("__iter__", [](const py::object& self) { return self; })
      .def("__next__", [](Recording& r) { return next(r.reader()); })
      .def_property_readonly("rig", &Recording::rig)
      .def_property_readonly(
          "fraction", [](const Recording& r) { return r.reader().fraction(); },
          "of the recording that was read")
      .def_property_readonly(
          "report", [](const Recording& r) { return report(r.reader()); },
          "per sensor: delivered, and dropped by reason")
      .def(
          "reference", [](const Recording& r) { return r.reader().reference(); },
          py::call_guard<py::gil_scoped_release>(),
          "The reference trajectory stored with the recording, or None.");
}

}  // namespace

void bind_readers(py::module_& m) {
  using Unlocked = py::call_guard<py::gil_scoped_release>;
  bind_recording(m);
  py::class_<io::LiveSequence>(
      m, "LiveSequence", "Puts samples that threads of drivers push in order of time; an iterator.")
      .def(py::init(&make_live), py::arg("rig"), py::arg("capacity") = io::LiveOptions{}.capacity,
           py::arg("reorder_s") = io::LiveOptions{}.reorder_s)
      .def("push", &io::LiveSequence::push, py::arg("sample"), Unlocked(),
           "From any thread; blocks while the queue is full. False after the end.")
      .def("finish", &io::LiveSequence::finish, Unlocked(), "Ends the input.")
      .def("stop", &io::LiveSequence::stop, Unlocked(), "Ends the sequence at once.")
      .def("__iter__", [](const py::object& self) { return self; })
      .def("__next__", [](io::LiveSequence& live) { return next(live); })
      .def_property_readonly("report", [](const io::LiveSequence& live) { return report(live); });
}

}  // namespace apvi::python
