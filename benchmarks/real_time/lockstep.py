"""Duration and reproducibility of 20 s of recorded excitation in lockstep.

`fake_hardware`, `recorder` and `excitation` run as separate processes, as in normal use. The motion
spans the commands' stamps, including approach and return. The duration is that of the excitation
process, from start to end.
"""

import argparse
import tempfile
from pathlib import Path

import numpy as np
from rclpy.node import Node
from timing.node_run import record_excitation, ros_node

from aerarm_msgs_py import topics
from aerarm_msgs_py.bags.bag_reader import read_joint_states

TOPICS = (topics.JOINT_STATES.name, topics.JOINT_COMMAND.name)
GOAL = 12.0  # [s]


def play(folder: Path, node: Node, priority: int) -> tuple[float, dict[str, dict[float, bytes]]]:
    """Play the excitation; return its duration [s], and the recorded messages by topic."""
    folder.mkdir()
    bag = folder / 'bag'
    took = record_excitation(node, folder, bag, 3, priority)
    return took, {topic: recorded(bag, topic) for topic in TOPICS}


def recorded(bag: Path, topic: str) -> dict[float, bytes]:
    """Return position, velocity and effort of a bag's messages by their stamps.

    A command is stored twice if the arm did not receive it and republished its state.
    """
    series = read_joint_states(bag, topic)
    rows = np.column_stack([series.position, series.velocity, series.effort])
    return {stamp: row.tobytes() for stamp, row in zip(series.stamp.tolist(), rows, strict=True)}


def repeats(first: dict[float, bytes], second: dict[float, bytes]) -> str:
    """Return a text with the number of common messages in which two runs differ."""
    common = first.keys() & second.keys()
    differ = sum(first[stamp] != second[stamp] for stamp in common)
    return f'{differ} of {len(common)} commands differ from those of the first run'


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        '--runs', type=int, default=3, help='number of times that the motion is played'
    )
    parser.add_argument('--priority', type=int, default=80, help='SCHED_FIFO priority; 0 for none')
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder, ros_node() as node:
        runs = [
            play(Path(folder) / str(run), node, options.priority) for run in range(options.runs)
        ]
    first = runs[0][1]
    stamps = sorted(first[topics.JOINT_COMMAND.name])
    print(f'motion of {stamps[-1] - stamps[0]:.1f} s, {len(stamps)} commands')
    times = [took for took, _ in runs]
    print(f'{"took, in each run [s]":38}' + ''.join(f'{t:8.1f}' for t in times))
    print(f'{"median [s]":38}{np.median(times):8.1f} (goal {GOAL:g}, idle machine)')
    for _, other in runs[1:]:
        for topic in TOPICS:
            print(f'{topic:38}{repeats(first[topic], other[topic])}')


if __name__ == '__main__':
    main()
