"""The last seconds as plots, of which a person chooses."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from html import escape

import numpy as np
import viser
from numpy.typing import NDArray

from aerarm_ros.ros.page.view_feed import BASE_ROWS, ROWS

Array = NDArray[np.float64]

_STROKES = ('#e8590c', '#1971c2', '#2f9e44', '#9c36b5', '#e03131', '#0c8599', '#f08c00')
_LIMIT = '#adb5bd'
_WIDTH, _HEIGHT = 440, 190  # [pixels]
_PADDING = (10, 24, 0, 0)  # [pixels] top, right, bottom, left: half a number at the top
_TICKS: viser.uplot.Axis_Ticks = {'show': True, 'stroke': 'rgba(128, 128, 128, 0.3)'}
_ACROSS = viser.uplot.Axis(size=64, ticks=_TICKS)  # [pixels] for a minus and three decimals


@dataclass(frozen=True)
class _Quantity:
    """What a plot shows: rows of `ROWS`, or of `BASE_ROWS` if there is no value.

    What is less than `small` about zero does not fill the plot: it would be noise, and numbers have
    three decimals.
    """

    title: str
    value: str = ''
    reference: str = ''
    limit: str = ''
    is_shown: bool = False
    small: float = 0.0


_QUANTITIES = (
    _Quantity('position [rad]', 'q', 'q_ref', 'position', True),
    _Quantity('velocity [rad/s]', 'dq', 'dq_ref', 'velocity', True, 0.01),
    _Quantity('effort [Nm]', 'tau', 'tau_ref', 'effort', True, 0.05),
    _Quantity('tracking error [rad]', 'error', small=4e-3),
    _Quantity('motor current [A]', 'current', small=0.05),
    _Quantity('electrical power [W]', 'power', small=0.5),
)
_BASE = (_Quantity('base position [m]', small=0.05), _Quantity('base attitude [rad]', small=0.01))


class ViewPlots:
    """A panel at the right of the scene, with a box to tick for each plot.

    Parameters
    ----------
    server
        Where it is shown.
    names
        Joint names, n of them.
    duration
        Time the plots show [s].
    limits
        (n, 2) of 'position', 'velocity' and 'effort', lower and upper.
    has_base
        Whether there is a base that moves.
    """

    def __init__(
        self,
        server: viser.ViserServer,
        names: Sequence[str],
        duration: float,
        limits: dict[str, Array],
        has_base: bool = False,
    ) -> None:
        gui = server.gui
        self._names, self._limits = names, limits
        self._duration = duration
        panel = gui.add_panel()
        with panel.add_tab('Plots'):
            with gui.add_folder('Which', expand_by_default=False):
                quantities = [*_QUANTITIES, *(_BASE if has_base else ())]
                boxes = {q: gui.add_checkbox(q.title, q.is_shown) for q in quantities}
                self._with_limits = gui.add_checkbox('limits', False)
            gui.add_html(_legend(names))
            self._plots = {q: self._add(gui, q) for q in quantities}
        for quantity, box in boxes.items():
            box.on_update(partial(self._show, quantity))
        panel.dock_right()
        panel.set_width(_WIDTH)

    def show(self, time: Array, values: Array) -> None:
        """Draw what is of the joints.

        Parameters
        ----------
        time
            (k,) [s], 0 is now.
        values
            (k, len(ROWS), n).
        """
        if len(time) < 2:
            return
        for quantity, plot in self._plots.items():
            if plot.visible and quantity.value:
                plot.data = self._columns(quantity, time, values)

    def show_base(self, time: Array, values: Array) -> None:
        """Draw what is of the base: (k,) [s], and (k, 6), columns as `BASE_ROWS`."""
        if len(time) < 2:
            return
        for quantity, columns in zip(_BASE, (values[:, :3], values[:, 3:]), strict=True):
            plot = self._plots.get(quantity)
            if plot is not None and plot.visible:
                plot.data = (time, *np.ascontiguousarray(columns.T))

    def _columns(self, quantity: _Quantity, time: Array, values: Array) -> tuple[Array, ...]:
        if quantity.value == 'error':
            error = values[:, ROWS.index('q_ref')] - values[:, ROWS.index('q')]
            return (time, *np.ascontiguousarray(np.nan_to_num(error.T)))
        rows = np.nan_to_num(values[:, ROWS.index(quantity.value)].T)
        columns = [rows]
        # What there is none of lies below the joint's own line: gaps would take the plot its scale.
        if quantity.reference:
            wanted = values[:, ROWS.index(quantity.reference)].T
            columns.insert(0, np.where(np.isnan(wanted), rows, wanted))
        if quantity.limit:
            limits = self._limits[quantity.limit].T[:, :, np.newaxis]
            shown = limits if self._with_limits.value else rows[np.newaxis]
            columns.insert(0, np.broadcast_to(shown, (2, *rows.shape)).reshape(-1, len(time)))
        return (time, *(np.ascontiguousarray(row) for part in columns for row in part))

    def _show(self, quantity: _Quantity, event: viser.GuiEvent[viser.GuiCheckboxHandle]) -> None:
        self._plots[quantity].visible = event.target.value

    def _add(self, gui: viser.GuiApi, quantity: _Quantity) -> viser.GuiUplotHandle:
        """Return a plot whose time axis is fixed: following its data, it freezes at the first."""
        series = self._series(quantity)
        start = np.array([-self._duration, 0.0])
        return gui.add_uplot(
            (start, *([np.zeros(2)] * len(series))),
            (viser.uplot.Series(label='t [s]'), *series),
            title=quantity.title,
            scales={'x': viser.uplot.Scale(time=False, range=(-self._duration, 0.0))}
            | _at_least(quantity.small),
            axes=(viser.uplot.Axis(ticks=_TICKS), _ACROSS),
            legend=viser.uplot.Legend(show=not quantity.value),
            height=_HEIGHT,
            padding=_PADDING,
            visible=quantity.is_shown,
        )

    def _series(self, quantity: _Quantity) -> list[viser.uplot.Series]:
        if not quantity.value:
            first = 0 if quantity is _BASE[0] else 3
            labels = BASE_ROWS[first : first + 3]
            return [_line(label, _color(k)) for k, label in enumerate(labels)]
        colors = [_color(k) for k in range(len(self._names))]
        lines = [_line(name, color) for name, color in zip(self._names, colors, strict=True)]
        # The joints last, so that they lie on top.
        if quantity.reference:
            lines = [_line('reference', color, (5, 4)) for color in colors] + lines
        if quantity.limit:
            lines = [_line('limit', _LIMIT, (2, 4))] * (2 * len(colors)) + lines
        return lines


def _at_least(small: float) -> dict[str, viser.uplot.Scale]:
    """Return a vertical scale that goes as far as `small` to each side of zero, or farther."""
    if not small:
        return {}
    sides = {'min': -small, 'max': small}
    limits = {side: {'pad': 0.1, 'soft': soft, 'mode': 1} for side, soft in sides.items()}
    return {'y': viser.uplot.Scale(range=limits)}


def _color(k: int) -> str:
    return _STROKES[k % len(_STROKES)]


def _legend(names: Sequence[str]) -> str:
    """Return which colour is whose, once for all plots."""
    colors = ''.join(
        f'<b style="color:{_color(k)};margin-right:1em">{escape(name)}</b>'
        for k, name in enumerate(names)
    )
    return f'<div style="padding:0 0.8em">{colors} dashed: reference</div>'


def _line(label: str, stroke: str, dash: tuple[int, ...] = ()) -> viser.uplot.Series:
    series = viser.uplot.Series(label=label, stroke=stroke, width=1.5 if not dash else 1.0)
    if dash:
        series['dash'] = dash
    return series
