"""What the bridge says about itself, for diagnostics."""

from collections.abc import Sequence

from aerarm_ros.hardware.boards.board_link import BoardLink
from aerarm_ros.hardware.boards.board_mode import BoardMode
from aerarm_ros.hardware.boards.encoder_zeros import EncoderZeros
from aerarm_ros.hardware.gate.command_intake import REJECTIONS, CommandIntake
from aerarm_ros.hardware.gate.joint_limiter import LIMITED
from aerarm_ros.hardware.gate.safety_gate import SafetyGate
from aerarm_ros.hardware.heat_watch import HeatWatch
from aerarm_ros.hardware.load_watch import LoadWatch

_RECENT = 1.0  # [s] how long a rejection or a limit stays in the list of faults


class BridgeReport:
    """Puts faults and counts of the bridge's parts into words.

    Parameters
    ----------
    intake, gate, links, zeros, heat, loads
        The parts.
    """

    def __init__(
        self,
        intake: CommandIntake,
        gate: SafetyGate,
        links: Sequence[BoardLink],
        zeros: EncoderZeros,
        heat: HeatWatch,
        loads: LoadWatch,
    ) -> None:
        self._heat = heat
        self._loads = loads
        self._zeros = zeros
        self._intake = intake
        self._gate = gate
        self._links = tuple(links)
        self._monitors = [link.monitor for link in links]

    def faults(self, mode: str, now: float) -> list[str]:
        """Return what is wrong, the latched stop first; rejections and limits for a second."""
        intake, gate = self._intake, self._gate
        texts = [gate.stop, *(monitor.fault for monitor in self._monitors)]
        for link in self._links:
            monitor = link.monitor
            if link.is_damped_unheard:
                texts.append(
                    f'{monitor.name} is not heard, and told to damp its joints in case it hears; '
                    f'disable switches it off: {monitor.problem}'
                )
            elif monitor.is_silent or monitor.mode is BoardMode.DISCONNECTED:
                texts.append(f'{monitor.name} does not answer: {monitor.problem}')
            elif not monitor.fault:
                texts.append(monitor.echo.warning)
        if mode in ('unhomed', 'fault'):
            texts.append(self._zeros.problem)
        if mode == 'damping':
            texts.append(
                f'no good command for {intake.age(now):.2f} s, the arm is damped: is the '
                'controller running?'
            )
        texts += [*self._heat.warnings(), *self._loads.warnings()]
        if now - intake.last_rejection_time < _RECENT:
            texts.append(f'a command was rejected: {REJECTIONS[intake.last_rejection]}')
        if now - gate.last_limited_time < _RECENT:
            texts.append(LIMITED[gate.last_limited])
        return list(dict.fromkeys(filter(None, texts)))

    def counters(self) -> dict[str, int]:
        """Return everything that is counted, by a name for diagnostics."""
        # Copies, because a diagnostics thread may ask while the loop counts on.
        rejections, limited = dict(self._intake.rejections), dict(self._gate.limited)
        counts = {'commands accepted': self._intake.accepted}
        counts |= {f'rejected {key}': count for key, count in rejections.items()}
        counts |= {f'limited {key}': count for key, count in limited.items()}
        for monitor in self._monitors:
            counts |= {f'{monitor.name} {key}': n for key, n in monitor.counters().items()}
        return counts
