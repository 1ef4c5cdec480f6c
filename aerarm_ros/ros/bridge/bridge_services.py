"""The bridge's services: a person's hand on the arm."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from rclpy.node import Node
from std_srvs.srv import Trigger

from aerarm_ros.hardware.gate.answer import Answer
from aerarm_ros.ros.bridge.cycle_requests import Action, NotActiveError

ACTIONS: dict[str, Action] = {
    'enable': lambda cycle: cycle.enable(),
    'hold': lambda cycle: cycle.hold(),
    'disable': lambda cycle: cycle.disable(),
    'clear_fault': lambda cycle: cycle.clear_fault(),
    'home': lambda cycle: cycle.home(),
    'e_stop': lambda cycle: cycle.e_stop('service e_stop'),
}
# What is done even if it comes late.
STOPS = {'disable', 'e_stop'}
# What goes to every arm: one too many that is damped is safe, one that is missed is not.
EVERYWHERE = {'e_stop'}


class BridgeServices:
    """One `std_srvs/Trigger` service an action, `~/enable`, `~/disable` and so on.

    Parameters
    ----------
    node
        Owner of the services.
    ask
        Runs an action in the cycle's thread, as `CycleRequests.ask` does.
    actions
        What there is, by name.
    """

    def __init__(
        self, node: Node, ask: Callable[[Action, bool], Answer], actions: Mapping[str, Action]
    ) -> None:
        self._node = node
        self._ask = ask
        for name, action in actions.items():
            node.create_service(Trigger, f'~/{name}', self._handler(name, action))

    def _handler(
        self, name: str, action: Action
    ) -> Callable[[Trigger.Request, Trigger.Response], Trigger.Response]:
        def handle(_: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
            log = self._node.get_logger()
            try:
                answer = self._ask(action, name in STOPS)
            except NotActiveError as error:
                # So are all asked that a controller sends while both end: nothing to warn of.
                log.info(f'{name}: {error}')
                response.success, response.message = False, str(error)
                return response
            except (RuntimeError, ValueError) as error:
                answer = Answer(False, str(error))
            except TimeoutError:
                answer = Answer(
                    False, 'the cycle did not answer: see the console of the bridge, or view'
                )
            response.success, response.message = answer.accepted, answer.message
            # rclpy ties a severity to the line that logs.
            if answer.accepted:
                log.info(f'{name}: {answer.message}')
            else:
                log.warning(f'{name}: {answer.message}')
            return response

        return handle
