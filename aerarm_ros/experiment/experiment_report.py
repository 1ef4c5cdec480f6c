"""Tracking errors of the experiment, as a table and as a page with a figure like 5.6."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from aerarm_ros.description.resources import write_whole
from aerarm_ros.description.robot import Robot
from aerarm_ros.experiment.experiment_bench import ExperimentCase, ExperimentRun
from aerarm_ros.model.kinematics import Kinematics
from aerarm_ros.motion.signals import Array
from aerarm_ros.pages.html_text import Html, origin, page, paragraph, section, table
from aerarm_ros.pages.plots import figure_html, plain_text, plotting_script
from aerarm_ros.simulation.base_profile import STILL

HEADINGS = (
    'control law; model of the controller; drone',
    'joints RMS [mrad]',
    'joints max [mrad]',
    'joints final [mrad]',
    'tool RMS [mm]',
    'tool max [mm]',
    'tool final [mm]',
    'RMS relative to the resting arm: joint, tool',
)
_MOST_POINTS = 1500
_TOOL_RMS = HEADINGS.index('tool RMS [mm]')


class ExperimentReport:
    """Report of the tracking errors of all runs.

    Parameters
    ----------
    robot
        Robot model for the tool's path.
    """

    def __init__(self, robot: Robot) -> None:
        self._kinematics = Kinematics(robot)
        self._runs: list[ExperimentRun] = []
        self._rows: list[tuple[str, ...]] = []
        self._still: dict[ExperimentCase, Array] = {}

    def add(self, run: ExperimentRun) -> tuple[str, ...]:
        """Add a run to the report, and return its row of the table of tracking errors."""
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
        """Return the table of tracking errors as text for a terminal."""
        rows = [HEADINGS, *self._rows]
        widths = [max(len(row[column]) for row in rows) for column in range(len(HEADINGS))]
        return '\n'.join(_aligned(row, widths) for row in rows)

    def write(self, path: Path, note: str) -> None:
        """Write the HTML page, which opens offline."""
        body: list[str] = [paragraph(note, 'lead')]
        for base in dict.fromkeys(run.case.base for run in self._runs):
            rows = [
                _numbers(row)
                for run, row in zip(self._runs, self._rows, strict=True)
                if run.case.base == base
            ]
            best = min(range(len(rows)), key=lambda k: float(rows[k][_TOOL_RMS]))
            body.append(section(f'Errors, drone {base}', table(HEADINGS, rows, [best])))
        body.append(section('Path of the tool', self._figure()))
        text = page('Dynamic controllers', plotting_script(), body, origin())
        write_whole(path, text)

    def _over_still(self, case: ExperimentCase, rms: Array) -> str:
        """Return the RMS errors divided by those of the same case on a still base, as text.

        The two ratios are those of the worst joint and of the tool. '' for a case with a still
        base, or if that case has not run on a still base.
        """
        if case.base == STILL:
            self._still[case] = rms
            return ''
        still = self._still.get(replace(case, base=STILL, aware=False))
        return '' if still is None else ' '.join(f'{ratio:.2f}' for ratio in rms / still)

    def _figure(self) -> Html:
        """Return a figure with the desired tool path, and the tool path in a selected run."""
        shown = np.flatnonzero(self._runs[0].at_full_speed)
        shown = shown[:: max(1, len(shown) // _MOST_POINTS)]
        desired = self._path(self._runs[0].qd[shown])
        extent = np.ptp(desired, axis=0) + 1e-3  # a flat path also needs a box
        traces = [_curve(desired, 'desired', True)]
        for index, run in enumerate(self._runs):
            traces.append(_curve(self._path(run.q[shown]), run.case.name, index == 0))
        choices = [
            {
                'label': run.case.name,
                'method': 'restyle',
                'args': ['visible', [True, *(other is run for other in self._runs)]],
            }
            for run in self._runs
        ]
        layout = {
            'height': 640,
            'margin': {'l': 0, 'r': 0, 't': 60, 'b': 0},
            'scene': {
                **{f'{axis}axis': {'title': {'text': f'{axis} [m]'}} for axis in 'xyz'},
                # Equal scales with the longest side 1.8; plotly's default exceeds the picture.
                'aspectratio': dict(
                    zip('xyz', (1.8 * extent / extent.max()).tolist(), strict=True)
                ),
            },
            'updatemenus': [{'buttons': choices, 'x': 0.0, 'xanchor': 'left', 'y': 1.12}],
            'legend': {'orientation': 'h', 'y': 0.0},
        }
        return figure_html('paths', traces, layout)

    def _path(self, q: Sequence[Array] | Array) -> Array:
        return np.array([self._kinematics.position(row) for row in q])


def _aligned(row: Sequence[str], widths: Sequence[int]) -> str:
    first, *others = (
        cell.ljust(width) if index == 0 else cell.rjust(width)
        for index, (cell, width) in enumerate(zip(row, widths, strict=True))
    )
    return '  '.join([first, *others])


def _numbers(row: Sequence[str]) -> list[str | float]:
    """Return a row of the table for the page, with texts of numbers converted to numbers."""
    return [float(x) if x.replace('.', '', 1).isdigit() else x for x in row]


def _curve(path: Array, name: str, is_seen: bool) -> dict[str, Any]:
    x, y, z = np.round(path, 5).T.tolist()
    line = {'width': 3}
    curve = {'type': 'scatter3d', 'mode': 'lines', 'x': x, 'y': y, 'z': z, 'line': line}
    return {**curve, 'name': plain_text(name), 'visible': is_seen}
