"""Folders of the page that move the arm, record, play and control."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from html import escape

import numpy as np
import viser
from numpy.typing import NDArray

from aerarm_ros.ros.page.child_program import ChildProgram
from aerarm_ros.ros.page.page_motion import PageMotion
from aerarm_ros.ros.page.page_programs import CONTROLLERS, PagePrograms
from aerarm_ros.ros.page.view_panel import ViewPanel, indented
from aerarm_ros.ros.page.view_scene import ARM_BASE

Array = NDArray[np.float64]

_STEP = 0.01  # [rad] of a slider
_TARGET_SCALE = 0.25
_LOOK_PERIOD = 1.0  # [s] between two looks for trajectories: a folder may hold many files


class ViewControls:
    """Sliders, a target for the tool, and programs.

    What a browser sends is judged here once more: a slider's number may be any.

    Parameters
    ----------
    server
        Where they are shown.
    panel
        Tells what came of it.
    motion, programs
        Do it.
    names, limits
        Joints, n of them, and (n, 2) their position limits [rad].
    """

    def __init__(
        self,
        server: viser.ViserServer,
        panel: ViewPanel,
        motion: PageMotion,
        programs: PagePrograms,
        names: Sequence[str],
        limits: Array,
    ) -> None:
        self._panel, self._motion, self._programs = panel, motion, programs
        self._limits = limits
        self._posture: Array | None = None
        self._tool = np.zeros(3)
        self._looked = -np.inf
        gui = server.gui
        with gui.add_folder('Control'):
            self._controller = gui.add_dropdown('controller', CONTROLLERS)
            self._control_button = gui.add_button('Start controller')
            self._control_words = gui.add_html('')
        with gui.add_folder('Move by hand', expand_by_default=False):
            self._share = gui.add_slider('speed limit', 0.05, 1.0, 0.05, 0.25)
            self._sliders = [
                gui.add_slider(name, float(low), float(high), _STEP, float(np.clip(0.0, low, high)))
                for name, (low, high) in zip(names, limits, strict=True)
            ]
            gui.add_button('Go there').on_click(lambda _: self._go())
            gui.add_button('Take the present posture').on_click(lambda _: self._take_posture())
            self._has_target = gui.add_checkbox('target for the tool, to drag', False)
        with gui.add_folder('Record a bag', expand_by_default=False):
            self._bag = gui.add_text('name', 'my_bag')
            self._record_button = gui.add_button('Start recording')
            self._record_words = gui.add_html('')
        with gui.add_folder('Play a motion', expand_by_default=False):
            self._file = gui.add_dropdown('motion', programs.trajectories())
            self._play_button = gui.add_button('Play')
            self._play_words = gui.add_html('')
        self._target = server.scene.add_transform_controls(
            f'{ARM_BASE}/tool_target', _TARGET_SCALE, disable_rotations=True, visible=False
        )
        self._connect()

    def show(self, now: float, posture: Array | None, tool: Array) -> None:
        """Show what the programs say.

        Parameters
        ----------
        now
            Monotonic time [s].
        posture
            (n,) [rad] where the arm is, or None.
        tool
            (3,) [m] where its tool is, in the base.
        """
        if self._posture is None and posture is not None:
            self._posture = posture
            self._take_posture()
        self._posture = posture if posture is not None else self._posture
        self._tool = tool
        for program, button, words, start, stop in (
            (
                self._programs.controller,
                self._control_button,
                self._control_words,
                'Start controller',
                'Stop controller: the arm is held',
            ),
            (
                self._programs.recorder,
                self._record_button,
                self._record_words,
                'Start recording',
                'Stop recording',
            ),
            (
                self._programs.player,
                self._play_button,
                self._play_words,
                'Play',
                'Stop the motion',
            ),
        ):
            button.label = stop if program.runs else start
            button.disabled = program.is_ending
            words.content = indented(escape(program.last_words()))
        if now - self._looked >= _LOOK_PERIOD:
            self._looked = now
            files = self._programs.trajectories()
            if tuple(self._file.options) != files:
                self._file.options = files

    def _connect(self) -> None:
        programs = self._programs
        self._control_button.on_click(
            lambda _: self._toggle(
                programs.controller,
                lambda: programs.control(self._controller.value, self._speed_share()),
            )
        )
        self._record_button.on_click(
            lambda _: self._toggle(programs.recorder, lambda: programs.record(self._bag.value))
        )
        self._play_button.on_click(
            lambda _: self._toggle(programs.player, lambda: programs.play(self._file.value))
        )
        self._has_target.on_update(lambda _: self._show_target())
        self._target.on_update(lambda _: self._aim())

    def _toggle(self, program: ChildProgram, start: Callable[[], object]) -> None:
        if program.runs:
            program.end()
            self._panel.tell(True, program.name, 'ends')
            return
        try:
            where = start()
        except (ValueError, RuntimeError, OSError) as error:
            self._panel.tell(False, 'not started:', str(error))
        else:
            self._panel.tell(True, program.name, str(where or 'starts'))

    def _go(self) -> None:
        goal = [slider.value for slider in self._sliders]
        low, high = self._limits.T
        if not (np.all(np.isfinite(goal)) and np.all(goal >= low) and np.all(goal <= high)):
            self._panel.tell(False, 'not sent:', 'the posture is beyond the limits')
        elif self._posture is None:
            self._panel.tell(False, 'not sent:', 'no joint_states came yet')
        else:
            done, text = self._motion.go(self._posture, goal, self._speed_share())
            self._panel.tell(done, 'Move' if done else 'not sent:', text)

    def _aim(self) -> None:
        place = np.array(self._target.position, float)
        if self._has_target.value and np.all(np.isfinite(place)):
            done, text = self._motion.aim(place.tolist())
            self._panel.tell(done, 'Target' if done else 'not sent:', text)

    def _show_target(self) -> None:
        self._target.position = np.array(self._tool)
        self._target.visible = self._has_target.value

    def _take_posture(self) -> None:
        if self._posture is None:
            return
        for slider, angle, (low, high) in zip(
            self._sliders, self._posture.tolist(), self._limits, strict=True
        ):
            slider.value = float(np.clip(angle, low, high))  # type: ignore[misc]

    def _speed_share(self) -> float:
        share = float(self._share.value)
        return float(np.clip(share, 0.05, 1.0)) if np.isfinite(share) else 0.05
