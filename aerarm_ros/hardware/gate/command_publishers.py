"""Tells the publishers of joint commands apart, and says which of them may command."""

from collections.abc import Collection, Mapping

from aerarm_ros.hardware.gate.offered_command import Source

_ONLY = 'the only publisher'
_STOP = 'stop all but one'


class CommandPublishers:
    """Says of each message which publisher it is from, and whether that one may command.

    The middleware's message info holds the publisher's global identifier (GID), and the list of
    the topic's endpoints names the node of each GID. `look` takes that list now and then. Until the
    first look that holds a GID, its node is unknown and not on any list.

    Where the message info has no GID, the sender of a command is unknown. Then commands are
    accepted while the topic has one publisher, and all are rejected while it has several.

    Parameters
    ----------
    allowed
        Nodes that may command, as names or as names with their name space; any if empty.

    Attributes
    ----------
    names
        Publishers at the last look, full names, sorted.
    """

    def __init__(self, allowed: Collection[str] = ()) -> None:
        self.names: tuple[str, ...] = ()
        self._allowed = frozenset(allowed)
        self._nodes: Mapping[bytes, str] = {}
        self._is_anonymous = False

    def look(self, nodes: Mapping[bytes, str]) -> None:
        """Take the full names of the nodes that publish now, by the GIDs of their publishers."""
        self._nodes = nodes
        self.names = tuple(sorted(nodes.values()))

    def knows(self, gid: bytes | None) -> bool:
        """Whether the last look has found the publisher; True where no message names one."""
        return gid is None or gid in self._nodes

    def judge(self, gid: bytes | None, matched: int) -> tuple[Source, bool]:
        """Tell who sent a message.

        Parameters
        ----------
        gid
            The publisher, as the message info says; None if it does not.
        matched
            How many publishers the subscription is matched with; only used without a GID.

        Returns
        -------
        source
            The publisher; None if it cannot be distinguished from another one.
        allowed : bool
            Whether its node may command.
        """
        self._is_anonymous = gid is None
        if gid is not None:
            return gid, self.is_allowed(self._nodes.get(gid, ''))
        is_alone = matched <= 1 and len(self.names) <= 1
        is_allowed = not self._allowed or bool(self.names)
        return _ONLY if is_alone else None, is_allowed and all(map(self.is_allowed, self.names))

    def is_allowed(self, name: str) -> bool:
        """Whether the list of allowed names holds a publisher's full name."""
        names = {name, name.removeprefix('/'), name.rpartition('/')[2]} - {''}
        return not self._allowed or not self._allowed.isdisjoint(names)

    @property
    def warning(self) -> str:
        """What is wrong with the publishers present, '' if nothing is."""
        others = [name for name in self.names if not self.is_allowed(name)]
        if others:
            return (
                f'{", ".join(others)} publishes joint_command without being on the list '
                'allowed_publishers: stop it, or add it to the list'
            )
        if len(self.names) < 2:
            return ''
        present = f'joint_command has {len(self.names)} publishers ({", ".join(self.names)})'
        if self._is_anonymous:
            return f'{present}, and this ROS does not name the sender of a command: {_STOP}'
        return f'{present}, the first to command is followed: {_STOP}'
