"""Figures of the identification report."""

from typing import Any

import numpy as np

from aerarm_ros.identification.identification_result import IdentificationResult
from aerarm_ros.identification.joint_model import COUPLED, JointTerm, TermKind
from aerarm_ros.identification.recording.recording import DesiredVelocity
from aerarm_ros.identification.regression.regression import SampleColumns
from aerarm_ros.motion.signals import Array
from aerarm_ros.pages.html_text import Html
from aerarm_ros.pages.plots import figure_html, plain_text

_SEGMENTS = 4  # number of disjoint segments in a motion


def amplitude_density(values: Array, dt: float) -> tuple[Array, Array]:
    """Return frequencies and amplitude spectral density, averaged over segments (Welch).

    Parameters
    ----------
    values : (M,) ndarray
        Evenly sampled values; M at least 8.
    dt : float
        Sampling time [s].

    Returns
    -------
    frequency, density : (K,) ndarray
        Frequency [Hz], and density [unit/sqrt(Hz)]; its squared integral is the variance.
    """
    length = max(8, len(values) // _SEGMENTS)
    starts = range(0, len(values) - length + 1, max(1, length // 2))
    window = np.hanning(length + 1)[:length]
    segments = np.array([values[start : start + length] for start in starts])
    segments = (segments - values.mean()) * window
    power = (np.abs(np.fft.rfft(segments, axis=1)) ** 2).mean(axis=0)
    power *= 2.0 * dt / float(window @ window)
    return np.asarray(np.fft.rfftfreq(length, dt)), np.asarray(np.sqrt(power))


MOST_POINTS = 1000
"""Largest number of points of a curve, about the resolution of a screen."""

_ROW_HEIGHT = 190  # [px] height of one joint's axes
# Measured curves are broad and pale, so that they stay visible under thin lines.
_LINES = {
    'measured': {'color': '#a9bdd6', 'width': 5.0},
    'predicted': {'color': '#0b4fa3', 'width': 1.3},
    'reference': {'color': '#d0672b', 'width': 1.3},
    'residual': {'color': '#b3261e', 'width': 1.3},
}
_CLOUD = {'color': '#7d94b5', 'size': 4}  # markers of single points


class StackedFigure:
    """Figure with one plot per joint, stacked vertically, with a common horizontal axis.

    Parameters
    ----------
    rows : sequence of str
        Titles of the axes, top to bottom.
    unit : str
        Unit of all vertical axes.
    x_title : str
        Title of the common axis.
    logarithmic : bool
        Whether all axes are logarithmic.
    most : int
        Largest number of points per curve, evenly spread.

    Attributes
    ----------
    traces : list of dict
        Curves added so far, in the plotting script's format.
    """

    def __init__(
        self,
        rows: tuple[str, ...],
        unit: str,
        x_title: str = 'time [s]',
        logarithmic: bool = False,
        most: int = MOST_POINTS,
    ) -> None:
        self._most = most
        self._kind = 'log' if logarithmic else 'linear'
        self._rows = rows
        self._unit = unit
        self._x_title = x_title
        self.traces: list[dict[str, Any]] = []

    def add(
        self,
        row: int,
        x: Array,
        y: Array,
        name: str,
        role: str,
        dash: str = 'solid',
        marked: bool = False,
    ) -> None:
        """Add a curve to the plot of one joint.

        Parameters
        ----------
        row : int
            Index of the plot.
        x, y : (M,) ndarray
            Points, reduced to `most`.
        name : str
            Name in the legend, shown once.
        role : str
            'measured', 'predicted', 'reference' or 'residual' determine colour and width of the
            line; 'cloud' means single points.
        dash : str
            Line style: 'solid', 'dot', 'dash'.
        marked : bool
            Whether to draw a marker at each point.
        """
        if role == 'cloud':
            look: dict[str, Any] = {'mode': 'markers', 'marker': _CLOUD}
        else:
            mode = 'lines+markers' if marked else 'lines'
            look = {'mode': mode, 'line': {**_LINES[role], 'dash': dash}}
        step = max(1, -(-len(x) // self._most))
        suffix = '' if row == 0 else str(row + 1)
        self.traces.append(
            {
                'type': 'scatter',
                **look,
                **_places(x[::step]),
                'y': _short(y[::step]),
                'name': name,
                'legendgroup': name,
                'showlegend': not any(trace['name'] == name for trace in self.traces),
                'xaxis': 'x',
                'yaxis': f'y{suffix}',
            }
        )

    def html(self, identifier: str) -> Html:
        """Return the figure as an HTML division with the script that draws it."""
        layout = self._layout()
        return figure_html(identifier, self.traces, layout)

    def _layout(self) -> dict[str, Any]:
        count = len(self._rows)
        layout: dict[str, Any] = {
            'height': _ROW_HEIGHT * count + 90,
            'margin': {'l': 75, 'r': 15, 't': 30, 'b': 45},
            'legend': {'orientation': 'h', 'y': 1.0 + 0.12 / count, 'yanchor': 'bottom'},
            'hovermode': 'x unified',
            'xaxis': {
                'title': {'text': self._x_title},
                'anchor': f'y{count if count > 1 else ""}',
                'type': self._kind,
            },
        }
        gap = 0.2 / count
        for row, title in enumerate(self._rows):
            top = 1.0 - row / count
            layout[f'yaxis{"" if row == 0 else row + 1}'] = {
                'domain': [max(0.0, top - 1.0 / count + gap), top],
                'title': {'text': f'{plain_text(title)} [{self._unit}]'},
                'type': self._kind,
            }
        return layout


def _places(x: Array) -> dict[str, Any]:
    """Return x positions as first value and spacing if equidistant, otherwise as a list."""
    if len(x) > 2 and np.ptp(np.diff(x)) <= 1e-6 * np.ptp(x):
        return {'x0': float(f'{x[0]:.8g}'), 'dx': float(f'{(x[-1] - x[0]) / (len(x) - 1):.8g}')}
    return {'x': _short(x)}


def _short(values: Array) -> list[float]:
    return [float(f'{value:.5g}') for value in values]


_NO_FRICTION = (TermKind.ROTOR, *COUPLED)
_CURVE = 201  # number of points of a friction curve, odd because dry friction jumps in the middle
_CLOUD_SIZE = 600  # number of measured points in the background
# Number of points of all bags together, and smallest number per bag; the figures of a dozen bags
# then fit into 3 MB.
_POINTS, _FEWEST = 2400, 200


def points(result: IdentificationResult) -> int:
    """Return the number of points of a curve over time, which falls with the number of bags."""
    bags = len(result.identification) + len(result.validation)
    return max(_FEWEST, min(MOST_POINTS, _POINTS // bags))


def torque_figure(
    result: IdentificationResult, bag: SampleColumns, predicted: Array, cad: Array
) -> StackedFigure:
    """Return a figure of measured and predicted torque over time, both low-pass filtered."""
    figure = StackedFigure(result.robot.joint_names, 'Nm', most=points(result))
    samples, kept = bag.samples, bag.samples.kept
    time = samples.time[kept]
    for joint in range(result.robot.n):
        figure.add(joint, time, samples.tau[kept, joint], 'measured, filtered', 'measured')
        figure.add(joint, time, cad[kept, joint], 'predicted, CAD', 'reference', 'dot')
        figure.add(joint, time, predicted[kept, joint], 'predicted, sdp', 'predicted')
    return figure


def residual_figure(
    result: IdentificationResult, bag: SampleColumns, predicted: Array
) -> StackedFigure:
    """Return a figure of measured minus predicted torque over time."""
    figure = StackedFigure(result.robot.joint_names, 'Nm', most=points(result))
    samples, kept = bag.samples, bag.samples.kept
    for joint in range(result.robot.n):
        left = samples.tau[kept, joint] - predicted[kept, joint]
        figure.add(joint, samples.time[kept], left, 'residual of sdp', 'residual')
    return figure


def spectrum_figure(
    result: IdentificationResult, bag: SampleColumns, predicted: Array
) -> StackedFigure:
    """Return a figure of the spectra of measured torque and its residual."""
    figure = StackedFigure(
        result.robot.joint_names, 'Nm/√Hz', 'frequency [Hz]', True, points(result)
    )
    samples, kept = bag.samples, bag.samples.kept
    dt = float(np.median(np.diff(samples.time)))
    below = 1.5 * result.conditioner.cutoff
    for joint in range(result.robot.n):
        tau = samples.tau[kept, joint]
        for values, name, role in (
            (tau, 'measured, filtered', 'measured'),
            (tau - predicted[kept, joint], 'residual of sdp', 'residual'),
        ):
            frequency, density = amplitude_density(values, dt)
            shown = (frequency > 0.0) & (frequency < below)
            figure.add(joint, frequency[shown], density[shown], name, role)
    return figure


def velocity_figure(
    result: IdentificationResult, bag: SampleColumns, desired: DesiredVelocity | None
) -> StackedFigure:
    """Return a figure of measured and, if known, commanded velocity over time."""
    figure = StackedFigure(result.robot.joint_names, 'rad/s', most=points(result))
    samples, kept = bag.samples, bag.samples.kept
    time = samples.time[kept]
    for joint in range(result.robot.n):
        figure.add(joint, time, samples.dq[kept, joint], 'measured', 'measured')
        if desired is not None:
            wanted = np.interp(time, desired.time, desired.dq[:, joint])
            figure.add(joint, time, wanted, 'desired', 'predicted')
    return figure


def friction_figure(result: IdentificationResult) -> StackedFigure:
    """Return a figure of each joint's modelled and measured friction torque over velocity.

    Measured friction is the torque measured in the identification bags, minus the modelled torque
    of links and rotors.
    """
    estimate, model = result.recommended.estimate, result.fit.model
    figure = StackedFigure(model.joint_names, 'Nm', 'velocity [rad/s]')
    inertial = estimate.inertial.ravel()
    values = estimate.theta[10 * model.n :]
    for joint in range(model.n):
        own = [
            (term, float(value))
            for (j, term), value in zip(model.joint_columns, values, strict=True)
            if j == joint and term.kind not in _NO_FRICTION
        ]
        dq, torque, load = _measured_friction(result, joint, own, inertial)
        if len(dq):  # empty for a joint at rest or with constant effort
            figure.add(joint, dq, torque, 'measured', 'cloud')
        speed = float(np.abs(dq).max(initial=1e-3)) * np.linspace(-1.0, 1.0, _CURVE)
        carried = np.full(_CURVE, float(np.median(load)) if len(load) else 0.0)
        curve = sum((v * t.basis(speed, carried, carried) for t, v in own), np.zeros(_CURVE))
        figure.add(joint, speed, curve, 'sdp, at the median load', 'predicted')
        drawn = result.cad.viscous[joint] * speed + result.cad.coulomb[joint] * np.sign(speed)
        figure.add(joint, speed, drawn, 'CAD', 'reference', 'dot')
    return figure


def _measured_friction(
    result: IdentificationResult, joint: int, own: list[tuple[JointTerm, float]], inertial: Array
) -> tuple[Array, Array, Array]:
    """Return velocity, filtered friction torque and load of selected identification samples."""
    parts = []
    assessed = result.recommended.identification
    for bag, errors in zip(result.identification, assessed, strict=True):
        samples = bag.samples
        rows = samples.usable[:, joint]
        friction = samples.tau[:, joint] - errors.prediction.filtered[:, joint]
        for term, value in own:
            friction = friction + value * bag.term(term, inertial)[:, joint]
        load = np.abs(bag.links_torque(inertial)[:, joint])
        parts.append(np.column_stack([samples.dq[:, joint], friction, load])[rows])
    stacked = np.vstack(parts)
    dq, torque, load = stacked[:: max(1, -(-len(stacked) // _CLOUD_SIZE))].T
    return dq, torque, load


def cutoff_figure(result: IdentificationResult) -> StackedFigure:
    """Return a figure of the held-out torque error of the tried filters over their cut-off."""
    figure = StackedFigure(('error',), '%', 'cut-off [Hz]')
    choice = result.filter_choice
    groups: dict[str, list[tuple[float, float]]] = {}
    for trial in choice.trials:
        groups.setdefault(trial.kinematics.source, []).append((trial.cutoff, trial.error))
    roles = ('predicted', 'reference', 'residual')
    for role, (source, points) in zip(roles, groups.items(), strict=False):
        cutoffs, errors = np.array(sorted(points)).T
        figure.add(0, cutoffs, errors, source, role, marked=True)
    chosen = [t.error for t in choice.trials if t.kinematics == choice.kinematics]
    if chosen:
        place = np.array([choice.conditioner.cutoff])
        figure.add(0, place, np.array(chosen[:1]), 'chosen', 'cloud')
    return figure
