import numpy as np
import pinocchio as pin

from aerarm_ros.description.drone_config import load_drone_config
from aerarm_ros.flight.arm_load import MassProperties


def test_mass_properties_of_drone_and_arm_agree_with_pinocchio() -> None:
    drone = load_drone_config()
    arm = pin.Inertia(1.5, np.array([0.02, -0.01, 0.4]), np.diag([0.08, 0.09, 0.01]))
    both = MassProperties.of(drone, arm.mass, arm.lever, arm.inertia)
    mount = pin.SE3(drone.mount.rotation, np.array(drone.mount.position))
    body = pin.Inertia(drone.mass, np.array(drone.centre_of_mass), drone.inertia_matrix)
    expected = body + mount.act(arm)
    assert both.mass == expected.mass
    np.testing.assert_allclose(both.centre, expected.lever, atol=1e-12)
    np.testing.assert_allclose(both.inertia, expected.inertia, atol=1e-12)
