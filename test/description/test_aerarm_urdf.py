"""The packaged URDF: inertia of thesis table A.1, and contacts only by design."""

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


def test_links_touch_beyond_the_limits_only(robot: Robot) -> None:
    shapes = Shapes(robot)
    corners = product(*zip(robot.position_min, robot.position_max, strict=True))
    rng = np.random.default_rng(7)
    inside = rng.uniform(robot.position_min, robot.position_max, (500, 4))
    for q in [*map(np.array, corners), *inside, np.zeros(4)]:
        assert shapes.touching(q) == set()
    low, high = robot.position_min[1], robot.position_max[3]
    for q, pair in (
        ([0.0, -np.pi / 2, 0.0, 0.0], (0, 2)),  # the arm runs into its base
        ([0.0, low - 0.4, 0.0, 0.0], (1, 2)),
        ([0.0, 0.0, 0.0, high + 0.7], (3, 4)),  # the tool runs into link 3
    ):
        assert pair in shapes.touching(np.array(q))
