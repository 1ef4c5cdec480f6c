"""Left panel of the page: the arm's mode, the emergency stop, and buttons for the bridge."""

from __future__ import annotations

import re
from collections.abc import Callable

import viser

from aerarm_ros.pages.html_text import Html
from aerarm_ros.ros.page.view_diagnostics import elements

# Sends the named request; returns whether it succeeded, and the answer. May block.
Ask = Callable[[str], tuple[bool, str]]

_ARM_WIDTH = 400  # [pixels]
_MODE_COLORS = {
    'aligning': '#b06000',
    'commissioning': '#b06000',
    'damping': '#b06000',
    'disconnected': '#c92a2a',
    'fault': '#c92a2a',
    'homing': '#b06000',
    'ready': '#2b8a3e',
    'running': '#2b8a3e',
    'unhomed': '#b06000',
}
# Label of each button, and the modes in which it has an effect.
_BUTTONS = {
    'enable': ('Enable: the arm moves while its motors align', ('idle',)),
    'hold': ('Hold the arm', ('damping',)),
    'home': (
        'Home: the arm must be in its home configuration',
        ('unhomed', 'idle', 'ready', 'running', 'damping'),
    ),
    'clear_fault': ('Clear fault', ('fault',)),
    'disable': (
        'Disable: the arm sinks',
        ('aligning', 'ready', 'homing', 'commissioning', 'running', 'damping', 'fault'),
    ),
    'put_back': ('Reset the emulated arm', ('idle', 'unhomed')),
}
_STEP = re.compile(rf"'arm ({'|'.join(_BUTTONS)})'")


class ViewPanel:
    """Left panel of the page, with the arm's mode and buttons that send requests to the bridge.

    All text from ROS messages is escaped before it becomes HTML.

    Parameters
    ----------
    server
        Server of the page.
    name
        Name of the arm.
    ask
        Sends a button's request to the bridge: 'e_stop', or a key of the bridge's actions.
    """

    def __init__(self, server: viser.ViserServer, name: str, ask: Ask) -> None:
        self._ask = ask
        self._name = name
        self._step = ''
        gui = server.gui
        gui.configure_theme(show_logo=False, show_share_button=False)
        gui.set_panel_label(name)
        gui.main_panel.dock_left()
        gui.main_panel.set_width(_ARM_WIDTH)
        self._mode = gui.add_html('')
        stop = gui.add_button('EMERGENCY STOP', color='red', icon=viser.Icon.HAND_STOP)
        stop.on_click(lambda _: self.answer('e_stop'))
        self._answer = gui.add_html('')
        self._next = gui.add_button('Next', color='orange', visible=False)
        self._next.on_click(lambda _: self.answer(self._step))
        self._buttons = {
            action: gui.add_button(label, visible=False) for action, (label, _) in _BUTTONS.items()
        }
        for action, button in self._buttons.items():
            button.on_click(self._answering(action))
        self.show_mode('', '')

    def _answering(self, action: str) -> Callable[[object], None]:
        return lambda _: self.answer(action)

    def add_reports(self, server: viser.ViserServer) -> None:
        """Add folders for the tables of motors and diagnostics to the panel."""
        with server.gui.add_folder('Motors'):
            self._motors = server.gui.add_html('')
        with server.gui.add_folder('Diagnostics'):
            self._diagnostics = server.gui.add_html('')

    def show_mode(
        self, mode: str, states: str, recovery_hint: str = '', emulated: bool = False
    ) -> None:
        """Show the arm's mode, a text about joint_states, and the buttons that act in this mode.

        Parameters
        ----------
        mode
            Newest arm_mode, '' before the first message.
        states
            Text about the received or missing joint states.
        recovery_hint
            Recovery hint of a fault from the bridge, with commands in quotes.
        emulated
            Whether the arm is emulated, so that its configuration can be reset.
        """
        shown = mode or 'waiting for a bridge'
        color = _MODE_COLORS.get(mode, '#495057')
        title = f'{shown} \N{MIDDLE DOT} {self._name}'
        self._mode.content = indented(elements().mode(shown, title, color, states, recovery_hint))
        step = _STEP.search(recovery_hint)
        self._step = step[1] if step else ''
        self._next.visible = bool(self._step)
        if self._step:
            self._next.label = f'Next step: {self._step}'
        for action, button in self._buttons.items():
            button.visible = mode in _BUTTONS[action][1] and (emulated or action != 'put_back')

    def show_diagnostics(self, motors: Html, statuses: Html) -> None:
        """Show the HTML tables of motors and diagnostics."""
        self._motors.content = indented(motors or elements().missing('no temperatures'))
        self._diagnostics.content = indented(statuses)

    def show_result(self, done: bool, word: str, text: str) -> None:
        """Show the result of a click on a button: a green or red word, then a text."""
        self._answer.content = indented(elements().outcome(done, word, text))

    def answer(self, action: str) -> None:
        """Send a button's request to the bridge, and show the bridge's answer."""
        if not action:
            return
        is_stop = action == 'e_stop'
        self._answer.content = indented(elements().bold(f'{"stopping" if is_stop else action}...'))
        done, text = self._ask(action)
        if is_stop:
            self.show_result(done, 'STOPPED' if done else 'NOT STOPPED', text)
        else:
            self.show_result(done, action if done else f'{action} rejected:', text)


def indented(content: str) -> str:
    """Return an HTML element that adds the panel's margin to a text or HTML."""
    return str(elements().indented(content))
