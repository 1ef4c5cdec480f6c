"""What stands beside the arm in the browser: mode, emergency stop, plots, jitter."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from html import escape

import numpy as np
import viser
from numpy.typing import NDArray

Array = NDArray[np.float64]

_PLOTS = ('position [rad]', 'velocity [rad/s]', 'effort [Nm]')
_STROKES = ('#e8590c', '#1971c2', '#2f9e44', '#9c36b5', '#e03131', '#0c8599', '#f08c00')
_MODE_COLORS = {
    'aligning': '#b06000',
    'damping': '#b06000',
    'fault': '#c92a2a',
    'ready': '#2b8a3e',
    'running': '#2b8a3e',
}
_ARM_WIDTH, _PLOT_WIDTH, _PLOT_HEIGHT = 440, 440, 190  # [pixels]


class ViewPanel:
    """The two panels at the sides of the scene.

    Everything that came from the ROS graph is escaped before it becomes HTML.

    Parameters
    ----------
    server
        Where they are shown.
    names
        Joint names, n of them.
    duration
        Time the plots show [s].
    stop
        Stops the arm; returns whether that succeeded and what to tell. May block.
    """

    def __init__(
        self,
        server: viser.ViserServer,
        names: Sequence[str],
        duration: float,
        stop: Callable[[], tuple[bool, str]],
    ) -> None:
        self._stop = stop
        gui = server.gui
        gui.configure_theme(show_logo=False, show_share_button=False)
        gui.set_panel_label('aerarm')
        gui.main_panel.dock_left()
        gui.main_panel.set_width(_ARM_WIDTH)
        self._mode = gui.add_html('')
        button = gui.add_button('EMERGENCY STOP', color='red', icon=viser.Icon.HAND_STOP)
        button.on_click(self._on_stop)
        self._answer = gui.add_html('')
        with gui.add_folder('Timing'):
            self._timing = gui.add_html('')
        with gui.add_folder('Diagnostics'):
            self._diagnostics = gui.add_html('')
        panel = gui.add_panel()
        with panel.add_tab('Joints'):
            self._plots = [_add_plot(gui, title, names, duration) for title in _PLOTS]
        panel.dock_right()
        panel.set_width(_PLOT_WIDTH)

    def show_mode(self, mode: str, states: str) -> None:
        """Show the arm's mode and a line about its states."""
        color = _MODE_COLORS.get(mode, '#495057')
        self._mode.content = _indented(
            f'<div style="font-size:1.6em;font-weight:bold;color:{color}">'
            f'{escape(mode or "no bridge found")}</div>{escape(states)}'
        )

    def show_diagnostics(self, timing: str, statuses: str) -> None:
        """Show two pieces of HTML, already escaped."""
        timing = timing or '<i>no timing statistics on /diagnostics yet</i>'
        self._timing.content = _indented(timing)
        self._diagnostics.content = _indented(statuses)

    def show_motion(self, time: Array, values: Array) -> None:
        """Draw the plots.

        Parameters
        ----------
        time
            (k,) [s], 0 is now.
        values
            (k, 3, n) position [rad], velocity [rad/s], effort [Nm].
        """
        if len(time) < 2:
            return
        for quantity, plot in enumerate(self._plots):
            plot.data = (time, *np.ascontiguousarray(values[:, quantity].T))

    def _on_stop(self, _: object) -> None:
        self._answer.content = _indented('<b>stopping...</b>')
        stopped, text = self._stop()
        word, color = ('STOPPED', '#2b8a3e') if stopped else ('NOT STOPPED', '#c92a2a')
        self._answer.content = _indented(f'<b style="color:{color}">{word}</b> {escape(text)}')


def _add_plot(
    gui: viser.GuiApi, title: str, names: Sequence[str], duration: float
) -> viser.GuiUplotHandle:
    """Return a plot whose time axis is fixed: one that follows its data freezes at the first."""
    lines = [
        viser.uplot.Series(label=name, stroke=_STROKES[k % len(_STROKES)], width=1.5)
        for k, name in enumerate(names)
    ]
    start = np.array([-duration, 0.0])
    return gui.add_uplot(
        (start, *([np.zeros(2)] * len(names))),
        (viser.uplot.Series(label='t [s]'), *lines),
        title=title,
        scales={'x': viser.uplot.Scale(time=False, range=(-duration, 0.0))},
        height=_PLOT_HEIGHT,
    )


def _indented(html: str) -> str:
    """Return HTML with the margin that the page gives to everything else."""
    return f'<div style="padding:0 0.8em">{html}</div>'
