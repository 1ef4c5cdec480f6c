"""Folder of the page that commissions a new arm."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from html import escape

import viser

from aerarm_ros.commissioning.commissioning_step import Prompt
from aerarm_ros.ros.page.page_commissioning import PageCommissioning
from aerarm_ros.ros.page.view_panel import ViewPanel, indented

ALL = 'all joints'
_READING = 1.0  # [s] that a prompt is shown before it can be confirmed: a second click is no answer
_LINES = 20


class ViewCommissioning:
    """Prompts, two answers, and what was found so far.

    Parameters
    ----------
    server
        Where it is shown.
    panel
        Tells what came of it.
    procedure
        Does it.
    names
        Joints, as files name them.
    emulated
        Returns the node name of a bridge with emulated boards, or ''.
    """

    def __init__(
        self,
        server: viser.ViserServer,
        panel: ViewPanel,
        procedure: PageCommissioning,
        names: Sequence[str],
        emulated: Callable[[], str],
    ) -> None:
        self._panel, self._procedure, self._emulated = panel, procedure, emulated
        self._prompt: Prompt | None = None
        self._since = 0.0
        gui = server.gui
        with gui.add_folder('Commission a new arm', expand_by_default=False):
            self._joint = gui.add_dropdown('joint to commission', (ALL, *names))
            self._resume = gui.add_checkbox('only what has not passed', False)
            self._hand = gui.add_checkbox('an emulated hand does it', False, visible=False)
            self._begin = gui.add_button('Begin commissioning')
            self._words = gui.add_html('')
            self._yes = gui.add_button('Done, go on', color='green', visible=False)
            self._no = gui.add_button('Leave this step out', visible=False)
        self._begin.on_click(lambda _: self._toggle())
        self._yes.on_click(lambda _: self._answer(True))
        self._no.on_click(lambda _: self._answer(False))

    def show(self, now: float) -> None:
        """Show the step, at a monotonic time [s], and the verdicts."""
        procedure = self._procedure
        runs, prompt = procedure.runs, procedure.prompt
        if prompt is not self._prompt:
            self._prompt, self._since = prompt, now
        self._hand.visible = bool(self._emulated())
        self._begin.label = 'Stop commissioning' if runs else 'Begin commissioning'
        is_asked = prompt is not None and not self._is_by_hand()
        for button in (self._yes, self._no):
            button.visible = is_asked
            button.disabled = not is_asked or now - self._since < _READING
        self._words.content = indented(self._text(runs, prompt))

    def _text(self, runs: bool, prompt: Prompt | None) -> str:
        lines = [escape(line) for line in self._procedure.news[-_LINES:]]
        if runs:
            step = prompt.text if prompt is not None else 'The bridge measures...'
            lines.append(f'<b>{escape(step)}</b>')
        passed, outcome = self._procedure.outcome
        if outcome:
            color = '#2b8a3e' if passed else '#c92a2a'
            lines.append(f'<b style="color:{color}">{escape(outcome)}</b>')
        elif self._procedure.record:
            lines.append(f'record: {escape(self._procedure.record)}')
        # A path has no place to break at, and would widen the panel.
        return f'<div style="overflow-wrap:anywhere">{"<br>".join(lines)}</div>'

    def _toggle(self) -> None:
        if self._procedure.runs:
            self._procedure.end()
            return
        joint = self._joint.value
        try:
            self._procedure.begin(
                [] if joint == ALL else [joint],
                self._resume.value,
                self._emulated() if self._is_by_hand() else '',
            )
        except RuntimeError as error:
            self._panel.tell(False, 'not begun:', str(error))

    def _answer(self, yes: bool) -> None:
        prompt = self._prompt
        if prompt is not None and not self._yes.disabled:
            self._procedure.answer(prompt, yes)

    def _is_by_hand(self) -> bool:
        """Whether an emulated hand answers: never with real boards."""
        return bool(self._hand.value and self._emulated())
