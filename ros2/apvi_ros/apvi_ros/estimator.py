# SPDX-License-Identifier: BSD-3-Clause
"""The estimator with a thread of its own, without ROS."""
import threading

import apvi

REPORT_EVERY = 200  # samples


class Estimator:
    """Samples of any thread in, in any order within a tenth of a second; poses out by a callback.

    on_pose(stamp, T_world_body [4,4]) is called from threads of the library."""

    def __init__(self, options, rig, on_pose):
        self._options, self._rig, self._on_pose = options, rig, on_pose
        self._begin()

    def _begin(self):
        self.error = ""
        self.report = {}
        self._abandoned = threading.Event()
        self._live = apvi.LiveSequence(self._rig)
        self.system = apvi.System(self._options, self._rig, on_pose=self._on_pose)
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def _run(self):
        try:
            for count, sample in enumerate(self._live):
                self.system.process(sample)
                if count % REPORT_EVERY == 0:
                    self.report = self._live.report
            if self._abandoned.is_set():
                self.system.stop()
            else:
                self.system.finish()
        except Exception as error:  # whatever it is, the node reports it and can be reset
            self.error = str(error)
            self._live.stop()
        self.report = self._live.report

    def push(self, sample):
        """False once the estimator has ended, by `finish` or by an error."""
        return self._live.push(sample)

    def finish(self):
        """Completes everything taken in."""
        self._live.finish()
        self._thread.join()

    def stop(self):
        """Abandons what was not begun."""
        self._abandoned.set()
        self._live.stop()
        self._thread.join()

    def reset(self):
        """Discards every sample, every estimate and the map."""
        self.stop()
        self._begin()
