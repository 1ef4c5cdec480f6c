"""Bridges are found by their services, not by their names."""

from answering_bridges import AnsweringBridges, until_offered
from rclpy.node import Node
from std_srvs.srv import SetBool, Trigger

from aerarm_ros.hardware.bridge_modes import ACTIONS
from aerarm_ros.ros.requests.bridge_service import BridgeFinder, bridges_among


def test_a_node_with_all_bridge_services_is_a_bridge() -> None:
    services = [f'/right/arm_of_mine/{action}' for action in (*ACTIONS, 'put_back')]
    services += [f'/hardware_bridge/{action}' for action in ACTIONS]
    services += ['/other_machine/e_stop', '/other_machine/enable']
    assert bridges_among(services) == ['/hardware_bridge', '/right/arm_of_mine']
    assert bridges_among([]) == []


def test_clients_and_servers_of_another_type_are_no_bridges(ros_node: Node) -> None:
    others = AnsweringBridges()
    for action in ACTIONS:
        others.node.create_client(Trigger, f'asked_for/{action}')
        others.node.create_service(SetBool, f'switch/{action}', lambda _, answer: answer)
    others.add('bridge', ACTIONS)
    finder = BridgeFinder(ros_node, 'e_stop', ['asked_for'])
    for name in ('bridge', 'switch'):
        for action in ACTIONS:
            until_offered(ros_node, f'{name}/{action}')
    assert list(finder.find()) == ['/bridge']
