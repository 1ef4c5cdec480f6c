"""Errors of the experiment, as a table and as an HTML page with a figure like 5.6."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import numpy.typing as npt
import plotly.graph_objects as go

from aerarm_ros.description.robot import Robot
from aerarm_ros.experiment.experiment_bench import ExperimentRun
from aerarm_ros.experiment.experiment_case import ExperimentCase
from aerarm_ros.identification.report.html_text import Html, page, paragraph, section, table
from aerarm_ros.model.kinematics import Kinematics
from aerarm_ros.simulation.base_profile import STILL

Array = npt.NDArray[np.float64]

HEADINGS = (
    'law; model of the controller; drone',
    'joints RMS [mrad]',
    'joints max [mrad]',
    'joints final [mrad]',
    'tool RMS [mm]',
    'tool max [mm]',
    'tool final [mm]',
    'RMS over still: joint, tool',
)
_MOST_POINTS = 1500


class ExperimentReport:
    """Collects runs and tells how well the arm followed.

    Parameters
    ----------
    robot
        For the tool's path.
    """

    def __init__(self, robot: Robot) -> None:
        self._kinematics = Kinematics(robot)
        self._runs: list[ExperimentRun] = []
        self._rows: list[tuple[str, ...]] = []
        self._still: dict[ExperimentCase, Array] = {}

    def add(self, run: ExperimentRun) -> tuple[str, ...]:
        """Add a run and return its row of the table."""
        joints = 1e3 * np.abs(run.qd - run.q)
        tool = 1e3 * np.linalg.norm(self._path(run.qd) - self._path(run.q), axis=1)
        final_joints, final_tool = joints[-1].max(), tool[-1]
        joints, tool = joints[run.at_full_speed], tool[run.at_full_speed]
        rms, tool_rms = np.sqrt((joints**2).mean(axis=0)), np.sqrt((tool**2).mean())
        row = (
            run.case.name,
            ' '.join(f'{value:.2f}' for value in rms),
            f'{joints.max():.2f}',
            f'{final_joints:.2f}',
            f'{tool_rms:.2f}',
            f'{tool.max():.2f}',
            f'{final_tool:.2f}',
            self._over_still(run.case, np.array([rms.max(), tool_rms])),
        )
        self._runs.append(run)
        self._rows.append(row)
        return row

    def text(self) -> str:
        """Return the table for a terminal."""
        rows = [HEADINGS, *self._rows]
        widths = [max(len(row[column]) for row in rows) for column in range(len(HEADINGS))]
        return '\n'.join(_aligned(row, widths) for row in rows)

    def write(self, path: Path, note: str) -> None:
        """Write the page; it needs no network."""
        body = [
            paragraph(note, 'lead'),
            section('Errors', table(HEADINGS, self._rows)),
            section('Path of the tool', Html(self._figure())),
        ]
        path.write_text(page('Dynamic controllers', '', body), encoding='utf-8')

    def _over_still(self, case: ExperimentCase, rms: Array) -> str:
        """Return how much larger the errors are than those of the same case on a still base.

        Of the joints the worst is taken; '' for a still base, or where that was not run.
        """
        if case.base == STILL:
            self._still[case] = rms
            return ''
        still = self._still.get(replace(case, base=STILL, aware=False))
        return '' if still is None else ' '.join(f'{ratio:.2f}' for ratio in rms / still)

    def _figure(self) -> str:
        figure = go.Figure()
        shown = np.flatnonzero(self._runs[0].at_full_speed)
        shown = shown[:: max(1, len(shown) // _MOST_POINTS)]
        desired = self._path(self._runs[0].qd[shown])
        extent = np.ptp(desired, axis=0) + 1e-3  # a flat path has a box too
        figure.add_trace(_curve(desired, 'desired', True))
        for index, run in enumerate(self._runs):
            # The first is seen; the others are there for a click in the legend.
            figure.add_trace(_curve(self._path(run.q[shown]), run.case.name, index == 0))
        figure.update_layout(
            height=600,
            scene={
                'xaxis_title': 'x [m]',
                'yaxis_title': 'y [m]',
                'zaxis_title': 'z [m]',
                # Equal scales, the longest side 1.8: plotly's own choice leaves the picture.
                'aspectratio': dict(zip('xyz', 1.8 * extent / extent.max(), strict=True)),
            },
            legend={'orientation': 'h', 'y': -0.05},
        )
        html: str = figure.to_html(full_html=False, include_plotlyjs=True)
        return html

    def _path(self, q: Sequence[Array] | Array) -> Array:
        return np.array([self._kinematics.position(row) for row in q])


def _aligned(row: Sequence[str], widths: Sequence[int]) -> str:
    first, *others = (
        cell.ljust(width) if index == 0 else cell.rjust(width)
        for index, (cell, width) in enumerate(zip(row, widths, strict=True))
    )
    return '  '.join([first, *others])


def _curve(path: Array, name: str, is_seen: bool) -> go.Scatter3d:
    x, y, z = np.round(path, 5).T
    return go.Scatter3d(
        x=x, y=y, z=z, mode='lines', name=name, visible=True if is_seen else 'legendonly'
    )
