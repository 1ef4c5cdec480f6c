"""Read bags and tables as recordings of one arm, for the identifier."""

from __future__ import annotations

import contextlib
import warnings
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from aerarm_msgs_py.bags.bag_reader import BagContents, read_contents
from aerarm_msgs_py.sequence_gaps import lost_messages
from aerarm_msgs_py.storage.read_limits import BagError, BagWarning, ReadLimits
from aerarm_ros.identification.errors import IdentificationError
from aerarm_ros.identification.recording.recording import (
    BagFacts,
    JointMapping,
    Recording,
    commanded_span,
    recording_from_states,
    running_span,
)
from aerarm_ros.identification.recording.table_file import (
    TABLES,
    TableOptions,
    TableStates,
    read_table,
)

_COMMAND, _MODE, _DIAGNOSTICS = 'joint_command', 'arm_mode', 'diagnostics'
_BAGS = ('.mcap', '.db3', '.bag')
_ACCEPTED = 'the identifier reads rosbag2 folders, and .mcap, .db3, .csv, .npz and ROS 1 .bag files'
_MAX_STATES = 2_000_000  # messages per bag, 33 min at 1 kHz, because memory is limited


@dataclass(frozen=True, eq=False)
class RecordedBag:
    """Content of one bag: joint states, and facts about their completeness."""

    recording: Recording
    facts: BagFacts


class IdentifierBags:
    """Read the joint states and the commands of one arm from bags and tables.

    Parameters
    ----------
    topic : str
        Joint state topic. The topics of commands, modes and diagnostics have the same namespace.
    joint_names : tuple of str
        The arm's joints, from base to tool.
    mapping : JointMapping
        Mapping from the joint names in the bags to the arm's joint names.
    limits : ReadLimits, optional
        Limits of time and memory while reading a bag.
    table : TableOptions, optional
        Units and sampling rate of tables.
    whole : bool
        Whether to use all messages of a bag, even those recorded while the arm rests.

    Attributes
    ----------
    messages : list of str
        Warnings from reading the bags.

    Raises
    ------
    IdentificationError
        If the mapping names a joint that the arm does not have.
    """

    def __init__(
        self,
        topic: str,
        joint_names: tuple[str, ...],
        mapping: JointMapping,
        limits: ReadLimits | None = None,
        table: TableOptions | None = None,
        whole: bool = False,
    ) -> None:
        self._whole = whole
        self._table = table or TableOptions()
        self._topic = '/' + topic.lstrip('/')
        self._joint_names = joint_names
        self._mapping = mapping
        self._limits = limits
        unknown = [name for name in mapping.effort_gain or {} if name not in joint_names]
        if unknown:
            raise IdentificationError(
                f'--effort-gain names the unknown joint {", ".join(unknown)}: the URDF has '
                f'{", ".join(joint_names)}'
            )
        self.messages: list[str] = []

    def read(self, path: Path, name: str) -> RecordedBag:
        """Read the recorded motion from a bag or a table.

        Parameters
        ----------
        path : Path
            rosbag2 directory, .mcap or .db3 file; or a table, .csv or .npz.
        name : str
            Name of the bag in reports and messages.

        Raises
        ------
        BagError
            If the bag cannot be read.
        IdentificationError
            If the content cannot be used for identification.
        """
        if path.suffix.lower() in TABLES and path.is_file():
            return self._read_table(path, name)
        notes: list[str] = []
        others = [self._in_namespace(topic) for topic in (_COMMAND, _MODE, _DIAGNOSTICS)]
        try:
            with collected_warnings(notes):
                others.append(f'/{_DIAGNOSTICS}')
                contents = read_contents(path, self._topic, others, _MAX_STATES, self._limits)
        except BagError as error:
            if path.is_file() and path.suffix not in _BAGS:
                notes.append(_ACCEPTED)
            raise BagError('; '.join([str(error), *notes])) from None
        states = contents.joint_states[self._topic]
        notes += _check_complete(name, self._topic, contents)
        self.messages += notes
        values = states.position, states.velocity, states.effort
        recording = recording_from_states(
            name,
            TableStates(states.names, states.stamp, *values),
            self._joint_names,
            self._mapping,
            self._commanded(contents),
            self._whole,
        )
        facts = BagFacts(
            recording.span.text if recording.span else 'whole bag',
            lost_messages(states.sequence.tolist()),
            contents.missed_cycles,
        )
        self.messages += facts.warnings(name, len(states) + contents.left_out)
        return RecordedBag(recording, facts)

    def _read_table(self, path: Path, name: str) -> RecordedBag:
        states = read_table(path, self._joint_names, self._table)
        recording = recording_from_states(
            name, states, self._joint_names, self._mapping, whole=self._whole
        )
        used = recording.span.text if recording.span else 'whole table'
        return RecordedBag(recording, BagFacts(used, columns=states.columns))

    def _in_namespace(self, topic: str) -> str:
        return f'{self._topic.rpartition("/")[0]}/{topic}'

    def _commanded(self, contents: BagContents) -> tuple[slice, str] | None:
        """Return the slice of messages with a commanded arm, and a description; None if unknown."""
        states = contents.joint_states[self._topic]
        modes = contents.texts.get(self._in_namespace(_MODE), [])
        span = running_span(states.log_time, states.position, modes)
        commands = contents.joint_states.get(self._in_namespace(_COMMAND))
        if span is None and commands is not None:
            span = commanded_span(states.stamp, states.position, commands.stamp)
        return span


def bag_names(paths: Sequence[Path]) -> dict[Path, str]:
    """Return a name per path of a bag: the file or folder name, or the path if names are equal."""
    paths = list(dict.fromkeys(paths))
    names = [path.resolve().name for path in paths]
    return {
        path: name if names.count(name) == 1 else str(path)
        for path, name in zip(paths, names, strict=True)
    }


def hold_out(recordings: list[Recording], share: float) -> tuple[list[Recording], list[Recording]]:
    """Divide each recording; return the first parts, and the last parts with this share."""
    if share == 0.0:
        return recordings, []
    cut = 1.0 - share
    names = f' [first {100 * cut:g} %]', f' [last {100 * share:g} %]'
    first = [recording.part(0.0, cut, names[0]) for recording in recordings]
    return first, [recording.part(cut, 1.0, names[1]) for recording in recordings]


def repeated_bags(identification: Sequence[Path], validation: Sequence[Path]) -> list[str]:
    """Return warnings about bags that the options name more than once."""
    notes = [
        f'the bag {path} is given {identification.count(path)} times for identification, so the '
        'computed uncertainty of the parameters is too small: pass each bag once'
        for path in dict.fromkeys(identification)
        if identification.count(path) > 1
    ]
    return notes + [
        (
            f'the bag {path} is used for identification and for validation, so its validation '
            'error is meaningless: pass another bag to --validation'
        )
        for path in dict.fromkeys(identification)
        if path in validation
    ]


def _check_complete(name: str, topic: str, contents: BagContents) -> list[str]:
    """Return warnings if the number of messages differs from the number in metadata.yaml.

    If a bag contains fewer messages than metadata.yaml lists, messages were lost after recording.
    A killed recorder leaves a metadata.yaml with a number that is too low, or no metadata.yaml.
    """
    kept, expected = len(contents.joint_states[topic]), contents.expected
    count = kept + contents.left_out
    notes = []
    if contents.left_out:
        notes.append(
            f'the identifier uses only the first {kept} of {count} messages on {topic} in the bag '
            f'{name}: cut the bag to the relevant motion'
        )
    if expected is None:
        notes.append(
            f'in the bag {name} metadata.yaml is missing or unreadable, so the recording may be '
            'incomplete: check that the recorder ended normally, and copy the whole bag'
        )
    elif count < expected:
        notes.append(
            f'the bag {name} is truncated: it contains {count} of the {expected} messages on '
            f'{topic} that metadata.yaml lists. Copy the whole bag again'
        )
    elif count > expected:
        notes.append(
            f'the bag {name} contains {count} messages on {topic}, but metadata.yaml lists '
            f'{expected}, because the recorder was killed. The end of the motion may be missing: '
            'record the bag again'
        )
    return notes


@contextlib.contextmanager
def collected_warnings(texts: list[str]) -> Iterator[None]:
    """Append warnings about a bag from a `with` block to `texts`, even after an error."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter('always')
        try:
            yield
        finally:
            notes = [warning for warning in caught if issubclass(warning.category, BagWarning)]
            texts += [str(warning.message) for warning in notes]
