"""Parameters of the node `payload_estimator`, and its file of friction estimates over weeks."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from dataclasses import fields
from pathlib import Path
from threading import Lock
from time import time
from typing import Any

from aerarm_ros.online.friction_trend import FrictionRecord, read_trend, write_trend
from aerarm_ros.online.payload_estimator import EstimatorSettings, OnlineEstimate
from aerarm_ros.ros.parameters.parameter import Parameter

ESTIMATOR_PARAMETERS = (
    Parameter('payload_mass', 0.5, 'standard deviation assumed for the mass of a payload', 'kg',
              1e-3, 50.0),
    Parameter('payload_size', 0.15,
        'standard deviation assumed for the distance of the parts of a payload from the last joint',
        'm', 0.01, 2.0),
    Parameter('tare_mass', 0.01,
        "standard deviation assumed for the mass error of the arm's model at the last link", 'kg',
        1e-4, 10.0),
    Parameter('friction_spread', 0.3,
        'standard deviation assumed for the difference between the friction and its model, as a '
        'fraction of the model', '', 0.01, 2.0),
    Parameter('torque_noise', 0.02,
        'RMS torque residual that the estimator assumes until it has measured the residual', 'Nm',
        1e-4, 10.0),
    Parameter('model_error', 0.01, (
        "standard deviation assumed for the model's gravity and inertia torques, as a fraction "
        'of these torques; the estimator does not attribute smaller torque errors to a payload'
    ), '', 1e-4, 0.5),
    Parameter('correlation_time', 0.1, 'correlation time of the torque error of the model', 's',
              0.02, 10.0),
    Parameter('bandwidth', 30.0,
        'cutoff frequency of the low-pass filters for both sides of the equation of motion', '1/s',
        5.0, 100.0),
    Parameter('memory', 30.0,
        'time after which the estimator forgets the payload if no informative motion confirms it',
        's', 1.0, 3600.0),
    Parameter('friction_memory', 120.0,
        'time after which the estimator forgets the friction if no informative motion confirms it',
        's', 1.0, 36000.0),
)  # fmt: skip


def estimator_settings(values: Any) -> EstimatorSettings:
    """Return the settings of a payload estimator; `values` has one attribute per parameter."""
    return EstimatorSettings(
        **{field.name: getattr(values, field.name) for field in fields(EstimatorSettings)}
    )


FRICTION_LOG_PARAMETERS = (
    Parameter('friction_file', '',
        'text file to which the node appends friction estimates over weeks; no file if empty'),
    Parameter('friction_interval', 600.0,
        'time of estimation between two records in friction_file', 's', 1.0, 86400.0),
)  # fmt: skip

_MAX_GAP = 0.1  # [s] a longer interval between two estimates does not count as estimation time
_MIN_LAST = 30.0  # [s] shortest estimation time for a record at the end of the node


class FrictionLog:
    """Record friction estimates periodically, and write the records to a file.

    Parameters
    ----------
    path : Path
        Path of the file. New records are appended to existing ones.
    interval : float
        Time of estimation between two records [s].
    clock : callable
        Returns the present time [s since 1970].

    Attributes
    ----------
    problem : str
        Reason why the last record could not be written; empty otherwise.

    Raises
    ------
    TrendFileError, OSError
        If the file contains no friction of this arm, or cannot be read or written.
    """

    def __init__(
        self,
        path: Path,
        joint_names: Sequence[str],
        interval: float,
        clock: Callable[[], float] = time,
    ) -> None:
        self._path = path
        self._interval = interval
        self._clock = clock
        self.problem = ''
        self._trend = read_trend(path, joint_names)
        if not os.access(path.parent, os.W_OK):
            raise OSError(
                f'friction_file cannot be written, because the folder {path.parent} is not '
                'writable: choose another folder'
            )
        self._last: OnlineEstimate | None = None
        self._learnt = 0.0
        self._pending: list[FrictionRecord] = []
        self._lock = Lock()

    def offer(self, estimate: OnlineEstimate) -> None:
        """Process a friction estimate without waiting for the disk."""
        if self._last is not None and 0.0 < estimate.time - self._last.time < _MAX_GAP:
            self._learnt += estimate.time - self._last.time
        self._last = estimate
        if self._learnt >= self._interval:
            self._record(estimate)

    def write(self) -> None:
        """Write the new records to the file; callable from any thread."""
        with self._lock:
            pending, self._pending = self._pending, []
            for record in pending:
                self._trend.add(record)
            if not pending and not self.problem:
                return
            try:
                write_trend(self._path, self._trend)
                self.problem = ''
            except OSError as error:
                self.problem = (
                    f'friction_file cannot be written ({error}): check its path and the free space'
                )

    def finish(self) -> None:
        """Record the last estimate and write the file; to be called when the node ends."""
        if self._last is not None and self._learnt >= min(self._interval, _MIN_LAST):
            self._record(self._last)
        self.write()

    def describe(self) -> dict[str, object]:
        """Return the number of records and the friction changes, for /diagnostics."""
        with self._lock:
            records, changes = self._trend.records, self._trend.changes()
        texts = [
            f'{change.name} {change.old:.4g} -> {change.new:.4g} '
            f'({change.deviations:+.1f} standard deviations)'
            for change in changes
            if change.is_clear
        ]
        return {
            'friction records': len(records),
            'friction changed since the first record': '; '.join(texts) or 'none',
        }

    def _record(self, estimate: OnlineEstimate) -> None:
        record = FrictionRecord(self._clock(), estimate.friction, estimate.friction_std)
        with self._lock:
            self._pending.append(record)
        self._learnt = 0.0
