"""Preview of an excitation trajectory as one HTML page that opens offline."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from aerarm_ros.description.robot import Robot
from aerarm_ros.excitation.design_file import write_design
from aerarm_ros.excitation.excitation_setup import ExcitationSetup
from aerarm_ros.excitation.trajectory import RampedExcitation
from aerarm_ros.excitation.trajectory_designer import DesignResult, TrajectoryDesigner
from aerarm_ros.model.kinematics import Kinematics
from aerarm_ros.motion.signals import Array
from aerarm_ros.pages.html_text import bullets, origin, page, paragraph, section, table
from aerarm_ros.pages.plots import plotly_figure, plotting_script

_STEP = 0.02
_LINE_COLOURS = ('#1f77b4', '#d9722e', '#2ca02c', '#9467bd', '#8c564b', '#e377c2', '#17becf')


class Preview:
    """HTML page of a trajectory: plots, workspace and parameter accuracy.

    Parameters
    ----------
    designer : designer with regressor and standard deviations.
    result : trajectory to show.
    reference : trajectory, usually a random one, with which the standard deviations of the
        parameters are compared.
    """

    def __init__(
        self, designer: TrajectoryDesigner, result: DesignResult, reference: DesignResult
    ) -> None:
        self._designer = designer
        self._setup: ExcitationSetup = designer.specification.setup
        self._result = result
        self._reference = reference
        self._tool = Kinematics(self._setup.robot, tool_frame(self._setup.robot))
        motion = RampedExcitation(result.trajectory, 1, self._setup.config.ramp_time)
        self._times: Array = np.arange(0.0, motion.duration, _STEP)
        self._states = motion.evaluate(self._times)

    def write(self, path: Path | str) -> None:
        """Write the preview page to a file.

        Raises
        ------
        ExcitationError
            If the page cannot be written.
        """
        write_design(path, self._page())

    def _page(self) -> str:
        trajectory = (
            'One period of the trajectory, with run-in and run-out. Dashed lines: limits of the '
            'excitation. Click a joint to hide it.'
        )
        workspace = (
            f'Path of {tool_frame(self._setup.robot)} in the base frame, and the covered fraction '
            'of each joint range.'
        )
        parameters = (
            'Expected standard deviation of the identifiable part of each parameter, after one '
            'period at 1 kHz with white torque noise. Smaller is better. A parameter without a '
            'bar cannot be identified from any motion of this arm.'
        )
        sections = [
            ('Trajectory', [self._trajectory()], trajectory),
            ('Workspace', [self._path(), self._coverage()], workspace),
            ('Excitation of each parameter', [self._deviations()], parameters),
        ]
        body: list[str] = [*self._summary()]
        for title, figures, text in sections:
            body.append(section(title, paragraph(text, 'note'), *map(plotly_figure, figures)))
        return page('Excitation trajectory', plotting_script(), body, origin())

    def _summary(self) -> list[str]:
        trajectory, quality = self._result.trajectory, self._result.quality
        other = self._reference.quality
        gain = np.exp(other.log_deviation - quality.log_deviation)
        lead = (
            f'{trajectory.harmonics} harmonics of {trajectory.f0:g} Hz. The condition number of '
            f'the regressor (thesis, equation 5.2) is {quality.condition_number:.1f}, for the '
            f'random initial motion {other.condition_number:.1f}. With columns scaled to equal '
            f'length, it is {quality.scaled_condition_number:.1f}, for the random motion '
            f'{other.scaled_condition_number:.1f}. The expected standard deviations of the '
            f'parameters are {gain:.2f} times smaller than with the random motion (geometric mean).'
        )
        rows = [
            (m.limit, m.subject, float(m.reached), float(m.allowed), float(m.margin), m.unit)
            for m in self._result.report.worst_of_each()
        ]
        headings = ('limit', 'closest', 'reached', 'allowed', 'margin', 'unit')
        parts: list[str] = [table(headings, rows)]
        notes = self._result.report.notes
        if notes:
            parts += [paragraph('Clearances that are reduced or not checked:'), bullets(notes)]
        return [paragraph(lead, 'lead'), section('Limits', *parts)]

    def _trajectory(self) -> go.Figure:
        limits, names = self._setup.usable_limits, self._setup.limits.joint_names
        effort = self._setup.effort_model.effort(*self._states)
        panels = (
            ('q [rad]', self._states.q, None),
            ('dq [rad/s]', self._states.dq, limits.velocity),
            ('ddq [rad/s²]', self._states.ddq, limits.acceleration),
            ('tau [Nm]', effort, limits.effort),
        )
        figure = make_subplots(rows=4, cols=1, shared_xaxes=True, vertical_spacing=0.03)
        for row, (title, values, bound) in enumerate(panels, start=1):
            figure.update_yaxes(title_text=title, row=row, col=1)
            for j, name in enumerate(names):
                colour = _LINE_COLOURS[j % len(_LINE_COLOURS)]
                figure.add_scatter(
                    x=self._times.astype(np.float32), y=values[:, j].astype(np.float32),
                    name=name, legendgroup=name, showlegend=row == 1,
                    line={'color': colour, 'width': 1.4}, row=row, col=1,
                )  # fmt: skip
                low, high = (
                    (limits.position_min[j], limits.position_max[j])
                    if bound is None
                    else (-bound[j], bound[j])
                )
                for level in (low, high):
                    if np.isfinite(level):
                        figure.add_scatter(
                            x=self._times[[0, -1]], y=[level, level], legendgroup=name,
                            mode='lines', showlegend=False, hoverinfo='skip', row=row, col=1,
                            line={'color': colour, 'width': 0.8, 'dash': 'dash'},
                        )  # fmt: skip
        figure.update_xaxes(title_text='t [s]', row=4, col=1)
        figure.update_layout(height=900, margin={'t': 20})
        return figure

    def _path(self) -> go.Figure:
        path = np.array([self._tool.position(q) for q in self._states.q])
        figure = go.Figure()
        figure.add_scatter3d(
            x=path[:, 0], y=path[:, 1], z=path[:, 2], mode='lines', showlegend=False,
            line={'width': 4, 'color': self._times, 'colorscale': 'Viridis', 'showscale': True,
                  'colorbar': {'title': 't [s]', 'x': 0.0, 'xanchor': 'left', 'len': 0.7}},
        )  # fmt: skip
        axes = {f'{axis}axis_title': f'{axis} [m]' for axis in 'xyz'}
        camera = {'eye': {'x': 1.9, 'y': 1.9, 'z': 1.1}, 'center': {'x': 0.0, 'y': 0.0, 'z': -0.12}}
        figure.update_layout(
            scene={'aspectmode': 'data', 'camera': camera, **axes},
            height=480,
            margin={'l': 0, 'r': 0, 't': 20, 'b': 0},
        )
        return figure

    def _coverage(self) -> go.Figure:
        limits, names = self._setup.limits, list(self._setup.limits.joint_names)
        span = np.minimum(limits.position_max - limits.position_min, 2.0 * np.pi)
        covered = 100.0 * np.ptp(self._states.q, axis=0) / span
        figure = go.Figure()
        figure.add_bar(x=np.round(covered, 1), y=names, orientation='h', showlegend=False,
                       marker_color='#5b8fb9')  # fmt: skip
        figure.update_xaxes(title_text='covered fraction of the joint range [%]', range=[0, 100])
        figure.update_yaxes(autorange='reversed', type='category')
        figure.update_layout(height=90 + 30 * len(names), margin={'t': 10, 'b': 60})
        return figure

    def _deviations(self) -> go.Figure:
        designer = self._designer
        samples = round(1000.0 * self._result.trajectory.period)
        names = np.array(designer.regressor.columns)
        figure = go.Figure()
        for label, result in (('random start', self._reference), ('this trajectory', self._result)):
            stacked = designer.stacked(designer.states(result.trajectory))
            deviation = designer.optimality.standard_deviations(stacked, samples)
            seen = deviation > 1e-9 * deviation.max()
            figure.add_bar(name=label, x=names[seen], y=deviation[seen])
        figure.update_yaxes(
            type='log', title_text='standard deviation [SI units]', exponentformat='e', dtick=1
        )
        # Show the names of all parameters; Plotly would omit some of them by default.
        figure.update_xaxes(tickangle=90, dtick=1, tickfont={'size': 9})
        figure.update_layout(barmode='group', height=480, margin={'t': 20})
        return figure


def tool_frame(robot: Robot) -> str:
    """Return the name of the frame on the last link that is farthest from the last joint."""
    frames = [
        frame
        for frame in robot.model.frames
        if frame.parentJoint == robot.n and frame.type == pin.FrameType.BODY
    ]
    return str(max(frames, key=lambda f: float(np.linalg.norm(f.placement.translation))).name)
