"""Bags as recordings of one arm."""

from __future__ import annotations

import contextlib
import warnings
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import yaml

from aerarm_msgs_py.bag_error import BagError
from aerarm_msgs_py.bag_reader import JointStateSeries, read_joint_states
from aerarm_ros.identification.recording import (
    JointMapping,
    Recording,
    recording_from_states,
)
from aerarm_ros.identification.report import DesiredVelocity

_COMMAND = 'joint_command'


class IdentifierBags:
    """Reads the joint states of one arm, and what was commanded.

    Parameters
    ----------
    topic : str
        Of the joint states; commands are looked for beside it.
    joint_names : tuple of str
        The arm's joints, from base to tool.
    mapping : JointMapping
        From the bags' joints to the arm's.

    Attributes
    ----------
    messages : list of str
        What reading the bags warned of.
    """

    def __init__(self, topic: str, joint_names: tuple[str, ...], mapping: JointMapping) -> None:
        self._topic = '/' + topic.lstrip('/')
        self._joint_names = joint_names
        self._mapping = mapping
        self.messages: list[str] = []

    def recording(self, path: Path, name: str) -> Recording:
        """Return a bag's motion.

        Parameters
        ----------
        path : Path
            rosbag2 directory or .mcap file.
        name : str
            For tables and messages.

        Raises
        ------
        BagError
            If the bag can't be read, or some of it is missing.
        IdentificationError
            If what it holds can't be identified from.
        """
        told: list[str] = []
        try:
            with _collected_warnings(told):
                states = read_joint_states(path, self._topic)
        except BagError as error:
            raise BagError('; '.join([str(error), *told])) from None
        _check_complete(path, self._topic, len(states.stamp))
        self.messages += told
        return recording_from_states(name, states, self._joint_names, self._mapping)

    def desired(self, path: Path, recording: Recording) -> DesiredVelocity | None:
        """Return the commanded velocities, if the bag has them for every joint."""
        topic = f'{self._topic.rpartition("/")[0]}/{_COMMAND}'
        try:
            with _collected_warnings([]):
                commands = read_joint_states(path, topic)
        except BagError:
            return None
        return self._velocities(commands, recording)

    def _velocities(
        self, commands: JointStateSeries, recording: Recording
    ) -> DesiredVelocity | None:
        names = [self._mapping.rename.get(name, name) for name in commands.names]
        if any(joint not in names for joint in self._joint_names):
            return None
        dq = commands.velocity[:, [names.index(joint) for joint in self._joint_names]]
        time, first = np.unique(commands.stamp - recording.start, return_index=True)
        given = np.isfinite(dq[first]).all(axis=1)
        if given.sum() < 2:
            return None
        return DesiredVelocity(time[given], dq[first][given])


def _check_complete(path: Path, topic: str, count: int) -> None:
    """Compare with the bag's own account: less than that was lost after recording.

    A recorder that was killed leaves an account that is too low, which is fine.
    """
    expected = _recorded_count(path, topic)
    if count < expected:
        raise BagError(
            f'{path} is truncated: it holds {count} of the {expected} messages of {topic} that its '
            'metadata.yaml lists; copy the bag again'
        )


def _recorded_count(path: Path, topic: str) -> int:
    """Return how many messages metadata.yaml lists, 0 if it doesn't say."""
    try:
        folder = path if path.is_dir() else path.parent
        document = yaml.safe_load((folder / 'metadata.yaml').read_text(encoding='utf-8'))
        topics = document['rosbag2_bagfile_information']['topics_with_message_count']
        counts = {entry['topic_metadata']['name']: entry['message_count'] for entry in topics}
        return int(counts.get(topic, 0))
    except (OSError, yaml.YAMLError, AttributeError, KeyError, TypeError, ValueError):
        return 0


@contextlib.contextmanager
def _collected_warnings(texts: list[str]) -> Iterator[None]:
    """Add what is warned of to a list, also if an error ends it."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter('always')
        try:
            yield
        finally:
            texts += [str(warning.message) for warning in caught]
