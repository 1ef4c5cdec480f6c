"""Plots of joint and motor quantities during the last seconds."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from itertools import cycle, islice

import numpy as np
import viser
from nav_msgs.msg import Odometry
from rclpy.node import Node

from aerarm_msgs_py import topics
from aerarm_msgs_py.codecs.cdr import Float64ArrayCdr
from aerarm_msgs_py.live_topics import RawReader
from aerarm_ros.motion.signals import Array
from aerarm_ros.ros.messages import quaternion, vector
from aerarm_ros.ros.page.view_diagnostics import elements
from aerarm_ros.ros.states.state_stream import StateSampler

# Rows stored per joint.
ROWS = ('q', 'dq', 'tau', 'q_ref', 'dq_ref', 'tau_ref', 'current', 'power', 'error')
_SILENT = 1.0  # [s] without states before a notice
_STALE = 0.3  # [s] after which a reference, a current or a power is dropped


class ViewFeed:
    """Subscribe to the plotted topics, and store samples of the last seconds.

    Parameters
    ----------
    node
        Owner of the subscriptions.
    names
        Names of the n joints.
    duration
        Stored time [s].
    rate
        Samples per second.
    has_base
        Whether to subscribe to `odometry` for the pose of the base.

    Attributes
    ----------
    posture
        (n,) newest joint positions [rad], None before the first message.
    pose
        Newest position (3,) [m] and unit quaternion (4,), real part first, of the base. None before
        the first message.
    """

    def __init__(
        self, node: Node, names: Sequence[str], duration: float, rate: float, has_base: bool
    ) -> None:
        n = len(names)
        self._duration = duration
        self._history: deque[tuple[float, Array]] = deque(maxlen=max(2, int(duration * rate)))
        self.posture: Array | None = None
        self.pose: tuple[Array, Array] | None = None
        self._states = StateSampler(node, names)
        self._commands = StateSampler(node, names, topics.JOINT_COMMAND)
        self._motors = StateSampler(node, names, topics.MOTOR_STATES)
        self._powers = RawReader(node, topics.MOTOR_POWER)
        self._power_cdr = Float64ArrayCdr(n)
        self._row = np.full((len(ROWS), n), np.nan)
        self._received_at = np.full(len(ROWS), -np.inf)
        self._odometry: Odometry | None = None
        if has_base:
            topics.ODOMETRY.subscription(node, self._on_odometry)

    def update(self, now: float) -> bool:
        """Read new messages, and return whether joint states arrived.

        `now` is the monotonic time [s].
        """
        self._take_rest(now)
        self._take_pose(now)
        state = self._states.newest()
        if state is None:
            return False
        self._received_at[0] = now
        self.posture = state[0]
        self._row[:3] = state
        self._row[-1] = self._row[3] - self._row[0]
        self._history.append((now, self._row.copy()))
        return True

    def window(self, now: float) -> tuple[Array, Array]:
        """Return the stored samples that are not older than `duration` [s].

        Returns
        -------
        time : (k,) relative to `now`, negative and ascending [s]
        values : (k, len(ROWS), n)
        """
        times = np.array([time for time, _ in self._history])
        first = int(np.searchsorted(times, now - self._duration))
        return times[first:] - now, np.array([row for _, row in islice(self._history, first, None)])

    def describe(self, now: float) -> str:
        """Return a text for the user about the received or missing messages on joint_states."""
        missing = self._states.missing
        if missing:
            return (
                f'joint_states lacks the joints {", ".join(missing)}: check the parameters config, '
                'urdf and tf_prefix of the node view'
            )
        if self._states.unknown:
            names = ', '.join(self._states.unknown)
            return (
                f'the angle of {names} is unknown, so the picture of the arm is wrong: home the arm'
            )
        silent = now - self._received_at[0]
        if not np.isfinite(silent):
            return 'no joint_states in this ROS domain: start a bridge, or check ROS_DOMAIN_ID'
        if silent > _SILENT:
            return (
                f'the last message on joint_states arrived {silent:.0f} s ago: check the log of '
                'the bridge'
            )
        return f'joint_states at {self._states.frequency(now):.0f} Hz'

    def destroy(self) -> None:
        """Destroy the subscriptions."""
        for reader in (self._states, self._commands, self._motors, self._powers):
            reader.destroy()

    def _take_rest(self, now: float) -> None:
        command, motors = self._commands.newest(), self._motors.newest()
        current = None if motors is None else motors[2]
        message = self._powers.take_newest()
        power = None if message is None else self._power_cdr.unpack(message[0])
        for rows, values in ((slice(3, 6), command), (6, current), (7, power)):
            if values is not None:
                self._row[rows] = values
                self._received_at[rows] = now
        self._row[3:8][now - self._received_at[3:8] > _STALE] = np.nan

    def _take_pose(self, now: float) -> None:
        message, self._odometry = self._odometry, None
        if message is None:
            return
        place = vector(message.pose.pose.position)
        turn = np.roll(quaternion(message.pose.pose.orientation), 1)
        if np.all(np.isfinite([*place, *turn])) and np.any(turn):
            turn /= np.linalg.norm(turn)
            self.pose = place, turn

    def _on_odometry(self, message: Odometry) -> None:
        self._odometry = message


_STROKES = ('#e8590c', '#1971c2', '#2f9e44', '#9c36b5', '#e03131', '#0c8599', '#f08c00')
_WIDTH, _HEIGHT = 440, 190  # [pixels]
_PADDING = (10, 24, 0, 0)  # [pixels] top, right, bottom, left; the top margin fits half a number
_TICKS: viser.uplot.Axis_Ticks = {'show': True, 'stroke': 'rgba(128, 128, 128, 0.3)'}
_ACROSS = viser.uplot.Axis(size=64, ticks=_TICKS)  # [pixels] for a minus and three decimals


@dataclass(frozen=True)
class _Quantity:
    """Quantity of one plot: its title, and the names of its data in `ROWS`.

    The vertical scale covers at least plus and minus `small`, so that noise does not fill the
    plot. The labels of the scale have three decimals.
    """

    title: str
    value: str
    reference: str = ''
    is_shown: bool = False
    small: float = 0.0


_QUANTITIES = (
    _Quantity('position [rad]', 'q', 'q_ref', True),
    _Quantity('velocity [rad/s]', 'dq', 'dq_ref', True, 0.01),
    _Quantity('effort [Nm]', 'tau', 'tau_ref', True, 0.05),
    _Quantity('tracking error [rad]', 'error', small=4e-3),
    _Quantity('motor current [A]', 'current', small=0.05),
    _Quantity('electrical power [W]', 'power', small=0.5),
)


class ViewPlots:
    """Right panel of the page, with the plots and one checkbox per plot.

    Parameters
    ----------
    server
        Server of the page.
    names
        Names of the n joints.
    duration
        Time span of the plots [s].
    """

    def __init__(self, server: viser.ViserServer, names: Sequence[str], duration: float) -> None:
        gui = server.gui
        self._names = names
        self._duration = duration
        panel = gui.add_panel()
        with panel.add_tab('Plots'):
            with gui.add_folder('Quantities', expand_by_default=False):
                boxes = {q: gui.add_checkbox(q.title, q.is_shown) for q in _QUANTITIES}
            gui.add_html(str(elements().legend(zip(cycle(_STROKES), names, strict=False))))
            self._plots = {q: self._add(gui, q) for q in _QUANTITIES}
        for quantity, box in boxes.items():
            box.on_update(partial(self._show, quantity))
        panel.dock_right()
        panel.set_width(_WIDTH)

    def show(self, time: Array, values: Array) -> None:
        """Draw the plots of the joints' quantities.

        Parameters
        ----------
        time
            (k,) time of the samples [s], 0 is now.
        values
            (k, len(ROWS), n) samples.
        """
        if len(time) < 2:
            return
        for quantity, plot in self._plots.items():
            if plot.visible:
                plot.data = self._columns(quantity, time, values)

    def _columns(self, quantity: _Quantity, time: Array, values: Array) -> tuple[Array, ...]:
        rows = np.nan_to_num(values[:, ROWS.index(quantity.value)].T)
        columns = [rows]
        # A missing reference repeats the joint's value, because gaps would remove the plot's scale,
        # and a plot cannot change its number of lines.
        if quantity.reference:
            wanted = values[:, ROWS.index(quantity.reference)].T
            columns.insert(0, np.where(np.isnan(wanted), rows, wanted))
        return (time, *(np.ascontiguousarray(row) for part in columns for row in part))

    def _show(self, quantity: _Quantity, event: viser.GuiEvent[viser.GuiCheckboxHandle]) -> None:
        self._plots[quantity].visible = event.target.value

    def _add(self, gui: viser.GuiApi, quantity: _Quantity) -> viser.GuiUplotHandle:
        """Create a plot of a quantity.

        The time axis is fixed, because an automatic time axis would not follow later data.
        """
        line = viser.uplot.Series
        colors = [color for _, color in zip(self._names, cycle(_STROKES), strict=False)]
        lines = [line(label='reference', stroke=c, width=1.0, dash=(5, 4)) for c in colors]
        # The curves of the joints are last, so that they are drawn on top.
        lines = lines if quantity.reference else []
        named = zip(self._names, colors, strict=True)
        lines += [line(label=name, stroke=color, width=1.5) for name, color in named]
        scales = {'x': viser.uplot.Scale(time=False, range=(-self._duration, 0.0))}
        if quantity.small:
            sides = {'min': -quantity.small, 'max': quantity.small}
            limits = {side: {'pad': 0.1, 'soft': soft, 'mode': 1} for side, soft in sides.items()}
            scales['y'] = viser.uplot.Scale(range=limits)
        return gui.add_uplot(
            (np.array([-self._duration, 0.0]), *([np.zeros(2)] * len(lines))),
            (viser.uplot.Series(label='t [s]'), *lines),
            title=quantity.title,
            scales=scales,
            axes=(viser.uplot.Axis(ticks=_TICKS), _ACROSS),
            legend=viser.uplot.Legend(show=False),
            height=_HEIGHT,
            padding=_PADDING,
            visible=quantity.is_shown,
        )
