"""A trajectory on one page that opens without a network."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from aerarm_ros.excitation.design.design_file import write_design
from aerarm_ros.excitation.design.design_result import DesignResult
from aerarm_ros.excitation.design.trajectory_designer import TrajectoryDesigner
from aerarm_ros.excitation.planning.excitation_setup import ExcitationSetup
from aerarm_ros.excitation.preview.arm_animation import ArmAnimation, scene
from aerarm_ros.excitation.trajectory.ramped_excitation import RampedExcitation
from aerarm_ros.motion.float_array import FloatArray
from aerarm_ros.pages.html_text import bullets, page, paragraph, section, table
from aerarm_ros.pages.page_origin import origin
from aerarm_ros.pages.plots import plotly_figure, plotting_script

_STEP = 0.02
_COLOURS = ('#1f77b4', '#d9722e', '#2ca02c', '#9467bd', '#8c564b', '#e377c2', '#17becf')


class Preview:
    """Writes plots, workspace, excitation of each parameter and an animation to HTML.

    Parameters
    ----------
    designer : for the regressor and the standard deviations.
    result : the trajectory.
    reference : a trajectory to compare the standard deviations with, usually a random one.
    """

    def __init__(
        self, designer: TrajectoryDesigner, result: DesignResult, reference: DesignResult
    ) -> None:
        self._designer = designer
        self._setup: ExcitationSetup = designer.specification.setup
        self._result = result
        self._reference = reference
        self._animation = ArmAnimation(self._setup.robot, self._setup.clearance)
        motion = RampedExcitation(result.trajectory, 1, self._setup.config.ramp_time)
        self._times: FloatArray = np.arange(0.0, motion.duration, _STEP)
        self._states = motion.evaluate(self._times)

    def write(self, path: Path | str) -> None:
        """Write the page.

        Raises
        ------
        ExcitationError
            If it cannot be written.
        """
        write_design(path, self._page())

    def _page(self) -> str:
        sections = [
            ('Trajectory', [self._trajectory()], 'One period with run-in and run-out. Dashed: what '
             'an excitation may use of the limits. Click a joint to hide it.'),
            ('Workspace', [self._path(), self._coverage()], 'Path of '
             f'{self._animation.tool_name} in the base frame, and the share of each joint range '
             'that is covered.'),
            ('Excitation of each parameter', [self._deviations()], 'Expected standard deviation of '
             'the part of each parameter that can be identified, after one period at 1 kHz with '
             'white torque noise. Smaller is better; a parameter without a bar cannot be seen by '
             'any motion of this arm.'),
            ('Animation', [self._animation.figure(self._times, self._states.q)],
             'Collision shapes in the postures of the trajectory.'),
        ]  # fmt: skip
        body: list[str] = [*self._summary()]
        for title, figures, text in sections:
            body.append(section(title, paragraph(text, 'note'), *map(plotly_figure, figures)))
        return page('Excitation trajectory', plotting_script(), body, origin())

    def _summary(self) -> list[str]:
        trajectory, quality = self._result.trajectory, self._result.quality
        other = self._reference.quality
        gain = np.exp(other.log_deviation - quality.log_deviation)
        lead = (
            f'{trajectory.harmonics} harmonics of {trajectory.f0:g} Hz. Condition number (5.2) '
            f'{quality.condition_number:.1f} (random start {other.condition_number:.1f}); with '
            f'scaled columns {quality.scaled_condition_number:.1f} '
            f'({other.scaled_condition_number:.1f}); standard deviations {gain:.2f} times smaller '
            'in the geometric mean.'
        )
        rows = [
            (m.limit, m.subject, float(m.reached), float(m.allowed), float(m.margin), m.unit)
            for m in self._result.report.worst_of_each()
        ]
        headings = ('limit', 'closest', 'reached', 'allowed', 'margin', 'unit')
        parts: list[str] = [table(headings, rows)]
        notes = self._result.report.notes
        if notes:
            parts += [paragraph('Clearances that are not checked, or reduced:'), bullets(notes)]
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
                colour = _COLOURS[j % len(_COLOURS)]
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
        path = self._animation.tool_path(self._states.q)
        figure = go.Figure()
        figure.add_scatter3d(
            x=path[:, 0], y=path[:, 1], z=path[:, 2], mode='lines', showlegend=False,
            line={'width': 4, 'color': self._times, 'colorscale': 'Viridis', 'showscale': True,
                  'colorbar': {'title': 't [s]', 'x': 0.0, 'xanchor': 'left', 'len': 0.7}},
        )  # fmt: skip
        figure.update_layout(scene=scene(), height=480, margin={'l': 0, 'r': 0, 't': 20, 'b': 0})
        return figure

    def _coverage(self) -> go.Figure:
        limits, names = self._setup.limits, list(self._setup.limits.joint_names)
        span = np.minimum(limits.position_max - limits.position_min, 2.0 * np.pi)
        covered = 100.0 * np.ptp(self._states.q, axis=0) / span
        figure = go.Figure()
        figure.add_bar(x=np.round(covered, 1), y=names, orientation='h', showlegend=False,
                       marker_color='#5b8fb9')  # fmt: skip
        figure.update_xaxes(title_text='covered share of the joint range [%]', range=[0, 100])
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
        # Every name, however many: Plotly leaves out what it finds too dense.
        figure.update_xaxes(tickangle=90, dtick=1, tickfont={'size': 9})
        figure.update_layout(barmode='group', height=480, margin={'t': 20})
        return figure
