"""The arm with an obstacle."""

from aerarm_ros.description.robot import Robot, load_robot


def with_box(robot: Robot, centre: str, size: str, link: str = 'base_link') -> Robot:
    """Return the arm with a box fixed to its base, in the base link or in a separate link."""
    box = (
        f'<collision name="box"><origin xyz="{centre}"/>'
        f'<geometry><box size="{size}"/></geometry></collision>'
    )
    if link == 'base_link':
        base = '<link name="base_link">'
        return load_robot(robot.urdf_text.replace(base, base + box))
    own = (
        f'<link name="{link}">{box}</link><joint name="{link}_fixed" type="fixed">'
        f'<parent link="base_link"/><child link="{link}"/></joint></robot>'
    )
    return load_robot(robot.urdf_text.replace('</robot>', own))
