"""The packaged URDF: inertia of thesis table A.1, and contacts only by design."""

import xml.etree.ElementTree as ElementTree
from itertools import product

import numpy as np
import pinocchio as pin
import pytest

from aerarm_ros.description.robot import Robot, load_robot


@pytest.fixture(scope='module')
def robot() -> Robot:
    return load_robot()


class Shapes:
    """Collision shapes of the arm, and which of them touch."""

    def __init__(self, robot: Robot) -> None:
        self.model = robot.model
        self.geometry = pin.buildGeomFromUrdfString(
            robot.model, robot.urdf_text, pin.GeometryType.COLLISION
        )
        self.geometry.addAllCollisionPairs()
        self.data = robot.model.createData()
        self.geometry_data = self.geometry.createData()

    def touching(self, q: np.ndarray) -> set[tuple[int, int]]:
        """Return the pairs of links (0 = base) that touch in a posture."""
        pin.computeCollisions(self.model, self.data, self.geometry, self.geometry_data, q, False)
        parents = [shape.parentJoint for shape in self.geometry.geometryObjects]
        return {
            (parents[pair.first], parents[pair.second])
            for pair, result in zip(
                self.geometry.collisionPairs, self.geometry_data.collisionResults, strict=True
            )
            if result.isCollision()
        }


def test_inertia_is_the_cad_column(robot: Robot, table_a1: dict[str, np.ndarray]) -> None:
    cad = table_a1['CAD'][:40].reshape(4, 10)
    assert np.allclose(robot.inertial_parameters, cad, rtol=1e-12, atol=1e-17)


def test_no_links_touch_within_the_limits(robot: Robot) -> None:
    shapes = Shapes(robot)
    corners = product(*zip(robot.position_min, robot.position_max, strict=True))
    rng = np.random.default_rng(7)
    inside = rng.uniform(robot.position_min, robot.position_max, (500, 4))
    for q in [*map(np.array, corners), *inside, np.zeros(4)]:
        assert shapes.touching(q) == set()


def test_joint_2_beyond_its_limits_runs_the_arm_into_its_base(robot: Robot) -> None:
    shapes = Shapes(robot)
    down = np.array([0.0, -np.pi / 2, 0.0, 0.0])
    assert (0, 2) in shapes.touching(down)
    nearly = np.array([0.0, robot.position_min[1] - 0.4, 0.0, 0.0])
    assert (1, 2) in shapes.touching(nearly)


def test_joint_4_beyond_its_limits_runs_the_tool_into_link_3(robot: Robot) -> None:
    folded = np.array([0.0, 0.0, 0.0, robot.position_max[3] + 0.7])
    assert (3, 4) in Shapes(robot).touching(folded)


def test_every_link_is_seen_as_it_collides(robot: Robot) -> None:
    root = ElementTree.fromstring(robot.urdf_text)
    for link in root.findall('link'):
        shapes = {
            kind: [
                (
                    shape.get('name').removesuffix('_visual'),
                    {} if shape.find('origin') is None else shape.find('origin').attrib,
                    [(child.tag, child.attrib) for child in shape.find('geometry')],
                )
                for shape in link.findall(kind)
            ]
            for kind in ('visual', 'collision')
        }
        assert shapes['visual'] == shapes['collision']
        assert shapes['visual'] or link.get('name') in ('wrist', 'tool0')
