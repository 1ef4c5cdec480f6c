"""Part of the web page on which the user commissions a new arm."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Sequence

import viser
from rclpy.node import Node

from aerarm_ros.commissioning.commissioning import Prompt
from aerarm_ros.pages.html_text import Html
from aerarm_ros.ros.executors import this_domain
from aerarm_ros.ros.page.view_diagnostics import elements
from aerarm_ros.ros.page.view_panel import ViewPanel, indented
from aerarm_ros.ros.requests.commissioning_client import CommissioningClient, EmulatedPerson

_PERIOD = 0.03  # [s]
_BRIDGE_TIMEOUT = 5.0  # [s]
_LINES = 20
_STOPPED = 'the procedure has stopped, and the motors are off'


class PageCommissioning:
    """Run one commissioning procedure at a time, in a separate thread.

    The bridge needs ten requests per second, but the thread that draws the page may be slower.

    Parameters
    ----------
    node
        Node that an executor spins in another thread.
    config, urdf
        Configuration and URDF of the arm, '' for the packaged files.
    is_watched
        Function that returns whether a browser shows the page. If no browser shows the page, the
        procedure ends with motors off.

    Attributes
    ----------
    outcome
        Whether the last procedure succeeded, and its result as text, which is empty before and
        during a procedure.
    """

    def __init__(self, node: Node, config: str, urdf: str, is_watched: Callable[[], bool]) -> None:
        self.outcome = False, ''
        self._node = node
        self._files = config, urdf
        self._is_watched = is_watched
        self._lock = threading.Lock()  # several threads serve clicks
        self._stop = threading.Event()
        self._thread: threading.Thread | None = None
        self._client: CommissioningClient | None = None

    @property
    def runs(self) -> bool:
        """Whether a commissioning procedure is running."""
        return self._thread is not None and self._thread.is_alive()

    @property
    def prompt(self) -> Prompt | None:
        """Commissioning prompt that the user must answer now, or None."""
        return self._client.prompt if self.runs and self._client is not None else None

    @property
    def news(self) -> list[str]:
        """Lines of text about the latest procedure: joints, findings, verdicts, and the record."""
        if self._client is None or self._client.guided is None:
            return []
        guided = self._client.guided
        has_record = guided.record.joints and not self.outcome[1]
        return guided.news[-_LINES:] + [f'record: {self._client.path}'] * bool(has_record)

    def begin(self, joints: Sequence[str], resume: bool, emulated: str = '') -> None:
        """Start commissioning the joints `joints`, or all joints of the arm if `joints` is empty.

        With `resume`, the procedure skips joints that have passed. If `emulated` names a bridge, an
        emulated hand turns the joints and confirms all prompts. Raises RuntimeError if a procedure
        is running.
        """
        with self._lock:
            if self.runs:
                raise RuntimeError('commissioning already runs: wait until it ends, or stop it')
            self._stop.clear()
            self.outcome, self._client = (False, ''), None
            arguments = (joints, resume, emulated)
            self._thread = threading.Thread(target=self._run, args=arguments, daemon=True)
            self._thread.start()

    def answer(self, prompt: Prompt, yes: bool) -> None:
        """Answer a commissioning prompt, or do nothing if the prompt is no longer shown."""
        with self._lock:
            guided = self._client.guided if self._client is not None else None
            if guided is not None and guided.prompt is prompt:
                guided.answer(yes)

    def end(self) -> None:
        """Stop the procedure, and wait until it has requested the bridge to disable the motors."""
        self._stop.set()
        if self._thread is not None:
            self._thread.join()

    def _run(self, joints: Sequence[str], resume: bool, emulated: str) -> None:
        client = None
        try:
            client = CommissioningClient(self._node, *self._files)
            self._find_bridge(client)
            client.begin(joints, resume)
            self._client = client
            self._lead(client, emulated)
            self.outcome = client.outcome
        except (ValueError, OSError) as error:
            self.outcome = False, str(error)
        finally:
            if client is not None:
                client.end()
                client.destroy()

    def _find_bridge(self, client: CommissioningClient) -> None:
        deadline = time.monotonic() + _BRIDGE_TIMEOUT
        while client.report is None:
            client.poll()
            self._pause()
            if time.monotonic() > deadline:
                raise ValueError(
                    f'no bridge answers: check that a bridge is active in {this_domain()}'
                )

    def _lead(self, client: CommissioningClient, emulated: str) -> None:
        if emulated and not (client.report and client.report.emulated):
            raise ValueError(
                'the emulated hand can turn only the joints of emulated boards: clear the checkbox '
                'of the emulated hand, then turn the joints yourself'
            )
        person = EmulatedPerson(self._node, client, emulated) if emulated else None
        while client.is_on:
            with self._lock:
                client.poll()
                if client.problem:
                    raise ValueError(client.problem)
                if person is not None:
                    person.poll()
            self._pause()
        client.poll()  # an answer may have ended the last joint

    def _pause(self) -> None:
        """Wait 0.03 s; raise ValueError if the user stopped the procedure or closed the page."""
        if self._stop.wait(_PERIOD):
            raise ValueError(_STOPPED)
        if not self._is_watched():
            raise ValueError(f'the page was closed: {_STOPPED}')


ALL = 'all joints'
_READING = 1.0  # [s] of display before a prompt can be confirmed, against double clicks


class ViewCommissioning:
    """Folder of the page that contains commissioning prompts, two answer buttons, and findings.

    Parameters
    ----------
    server
        Server of the page.
    panel
        Panel that shows an error.
    procedure
        Commissioning procedure.
    names
        Joint names in the arm's configuration.
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
            self._resume = gui.add_checkbox('only joints that have not passed', False)
            self._hand = gui.add_checkbox('an emulated hand turns the joints', False, visible=False)
            self._begin = gui.add_button('Begin commissioning')
            self._words = gui.add_html('')
            self._yes = gui.add_button('Done, continue', color='green', visible=False)
            self._no = gui.add_button('Skip this step', visible=False)
        self._begin.on_click(lambda _: self._toggle())
        self._yes.on_click(lambda _: self._answer(True))
        self._no.on_click(lambda _: self._answer(False))

    def show(self, now: float) -> None:
        """Show the procedure's present step and verdicts; `now` is the monotonic time [s]."""
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

    def _text(self, runs: bool, prompt: Prompt | None) -> Html:
        lines = self._procedure.news
        if runs:
            step = prompt.text if prompt is not None else 'The bridge is measuring...'
            lines.append(elements().bold(step))
        passed, outcome = self._procedure.outcome
        if outcome:
            lines.append(elements().outcome(passed, outcome, ''))
        return Html(elements().lines(lines))

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
            self._panel.show_result(False, 'not started:', str(error))

    def _answer(self, yes: bool) -> None:
        prompt = self._prompt
        if prompt is not None and not self._yes.disabled:
            self._procedure.answer(prompt, yes)

    def _is_by_hand(self) -> bool:
        """Return whether the emulated hand, which needs emulated boards, answers the prompts."""
        return bool(self._hand.value and self._emulated())
