"""Encryption and authentication of datagrams with a shared key, and the connection handshake.

ChaCha20-Poly1305 (RFC 8439) of the library `cryptography` seals each datagram. The key of a session
is derived from the shared key and a random number, the session number, so no counter is used twice
with one key. There is no forward secrecy: anyone with the shared key can read recorded datagrams.

The session number is also the challenge of the handshake. Each datagram contains the session number
of its receiver. A greeting is a datagram to an unknown end. An end answers it with a new session
number, and accepts the other end once a datagram is addressed to this number. A recorded datagram
therefore cannot open a connection, change an address or replace a live end. An end stores only a
limited number of greetings, so greetings cannot fill its memory.
"""

from __future__ import annotations

import hashlib
import hmac
import os
import secrets
import struct
from math import inf
from pathlib import Path
from typing import NamedTuple

from cryptography.exceptions import InvalidTag
from cryptography.hazmat.primitives.ciphers.aead import ChaCha20Poly1305

KEY_SIZE = 32
"""Size of the shared key [bytes]."""
SESSION_SIZE = 8
NO_SESSION = bytes(SESSION_SIZE)
"""Placeholder for the receiver's session number while the sender does not know it."""
OVERHEAD = SESSION_SIZE + 8 + SESSION_SIZE + 16
"""Number of bytes that encryption adds to the content of a datagram."""

_HEADER = struct.Struct(f'<{SESSION_SIZE}sQ')
_CALLER = 'ground'  # role of the end that calls the other
_COUNTER_MAX = 2**32  # datagrams, for years
_WINDOW = 128  # datagrams that may overtake each other
_OFFER = 5.0  # [s] for which an end offers a session number, and again accepts it
_ANSWER_EVERY, _ANSWERS = 0.02, 8  # [s] for one answer per session, and for eight answers in all
_FIRST_ANSWERS = 64  # sessions of which the time of the first answer is stored
# [s] added to the duration of the handshake, while datagrams of former sessions can still arrive.
# An answer to one of them would begin the next handshake.
_SETTLING = 1.0


def looks_sealed(datagram: bytes) -> bool:
    """Return whether a datagram has this protocol's format, whatever its key is."""
    if len(datagram) < OVERHEAD:
        return False
    _, counter = _HEADER.unpack_from(datagram)
    return 0 < int(counter) < _COUNTER_MAX


class KeyFileError(ValueError):
    """Error: the key file is missing or invalid; the message states what to do."""


def make_key(path: Path) -> None:
    """Write a new shared key to a file that only its owner can read.

    Raises
    ------
    KeyFileError
        If the file exists, because a new key would exclude the other end.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    try:
        descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
    except FileExistsError:
        raise KeyFileError(f'key file {path} already exists: copy it to the other host') from None
    with os.fdopen(descriptor, 'w') as stream:
        stream.write(secrets.token_hex(KEY_SIZE) + '\n')


def read_key(path: Path) -> bytes:
    """Read the shared key from a file.

    Raises
    ------
    KeyFileError
        If the file is missing, readable by others, or contains no key.
    """
    try:
        text = path.read_text(encoding='ascii', errors='replace').strip()
        mode = path.stat().st_mode
    except OSError as error:
        raise KeyFileError(
            f'key file {path} cannot be read ({error.strerror}): start ground_link on the drone, '
            'which creates a key file, and copy it to the ground host'
        ) from None
    if mode & 0o077:
        raise KeyFileError(f'key file {path} is readable by other users: run chmod 600 {path}')
    try:
        key = bytes.fromhex(text)
    except ValueError:
        key = b''
    if len(key) != KEY_SIZE:
        raise KeyFileError(
            f'key file {path} must contain {2 * KEY_SIZE} hexadecimal digits: copy it again'
        )
    return key


class Opened(NamedTuple):
    """Content of an authentic datagram from the connected end.

    Attributes
    ----------
    body
        Decrypted content.
    is_newest
        Whether no later datagram of the session has arrived. Its address is then the current one.
    has_joined
        Whether the datagram completed a handshake, after which both ends reset the connection.
    """

    body: bytes
    is_newest: bool
    has_joined: bool


class Session:
    """One end of an encrypted connection: handshake, encryption and decryption of datagrams.

    Parameters
    ----------
    key
        Key that both ends share.
    role, other_role
        Roles of both ends, which must differ. Because the roles differ, a datagram that is
        reflected to its sender is rejected.

    Attributes
    ----------
    answer
        Reply to the sender of the datagram that was received last, or None.
    rejected
        Number of received datagrams whose authentication with the shared key failed.
    """

    def __init__(self, key: bytes, role: str, other_role: str) -> None:
        self.answer: bytes | None = None
        self.rejected = 0
        self._key, self._role, self._other_role = key, role, other_role
        self._own: _Sealer | None = None
        self._peer = _Peer(NO_SESSION, None, 0)
        self._offered, self._offered_at = _Sealer(key, role), -inf
        self._settled_at = -inf
        self._answered: dict[bytes, float] = {}
        self._first_answers: dict[bytes, float] = {}

    @property
    def is_joined(self) -> bool:
        """Whether the handshake with the other end is complete."""
        return self._own is not None

    def greeting(self, now: float) -> bytes:
        """Return a datagram that requests a connection to the other end, at `now` [s]."""
        return self._offer(now).seal(NO_SESSION, b'')

    def seal(self, body: bytes) -> bytes:
        """Encrypt `body` as a datagram for the connected end."""
        assert self._own is not None
        return self._own.seal(self._peer.session, body)

    def open(self, datagram: bytes, now: float, is_up: bool) -> Opened | None:
        """Decrypt a datagram received at `now` [s]; set `answer` if it requests a connection.

        The result is None unless the datagram is authentic, addressed to the current session,
        and neither repeated nor much older than others.

        `is_up` means that the other end is connected. In that case a ground answers only greetings
        that are addressed to its current session, as a restarted drone sends them. If the ground
        answered every greeting, an attacker could pass on the drone's answer to a recorded
        greeting, and so restart the connection.
        """
        self.answer = None
        if len(datagram) < OVERHEAD:
            self.rejected += 1
            return None
        header = datagram[: _HEADER.size]
        session, counter = _HEADER.unpack(header)
        is_peer = self.is_joined and session == self._peer.session
        cipher = self._peer.cipher if is_peer else None
        cipher = cipher or _cipher(self._key, self._other_role, session)
        try:
            plain = cipher.decrypt(_nonce(counter), datagram[_HEADER.size :], header)
        except InvalidTag:
            self.rejected += 1
            return None
        to, body = plain[:SESSION_SIZE], plain[SESSION_SIZE:]
        if to == self._offered.session and now - self._offered_at < 2.0 * _OFFER:
            self._own, self._peer = self._offered, _Peer(session, cipher, counter)
            begin = self._first_answers.get(session, self._offered_at)
            self._settled_at = now + (now - begin) + _SETTLING
            self._offered_at = -inf  # the next greeting gets another number
            return Opened(body, True, True)
        if is_peer and not self._peer.is_new(counter):
            return None
        is_current = self._own is not None and to == self._own.session
        if is_peer and is_current:
            return Opened(body, counter == self._peer.newest, False)
        if now >= self._settled_at and (is_current or not is_up or self._role != _CALLER):
            self._greeted(session, now)
        return None

    def _greeted(self, session: bytes, now: float) -> None:
        """Answer a connection request (greeting), at a limited rate because of replays."""
        answered = self._answered
        recent = {key: when for key, when in answered.items() if now - when < _ANSWER_EVERY}
        if session not in recent and len(recent) < _ANSWERS:
            self.answer = self._offer(now).seal(session, b'')
            recent[session] = now
            first = {key: when for key, when in self._first_answers.items() if now - when < _OFFER}
            if len(first) < _FIRST_ANSWERS:
                first.setdefault(session, now)
            self._first_answers = first
        self._answered = recent

    def _offer(self, now: float) -> _Sealer:
        """Return the session for answers to connection requests, which changes every 5 s."""
        if now - self._offered_at > _OFFER:
            self._offered, self._offered_at = _Sealer(self._key, self._role), now
        return self._offered


class _Sealer:
    """Session of this end, with its number, cipher and counter of sent datagrams."""

    def __init__(self, key: bytes, role: str) -> None:
        self.session = secrets.token_bytes(SESSION_SIZE)
        self._cipher = _cipher(key, role, self.session)
        self._counter = 0

    def seal(self, to: bytes, body: bytes) -> bytes:
        self._counter += 1
        header = _HEADER.pack(self.session, self._counter)
        return header + self._cipher.encrypt(_nonce(self._counter), to + body, header)


class _Peer:
    """Session of the other end, with its number, cipher and counters of received datagrams."""

    def __init__(self, session: bytes, cipher: ChaCha20Poly1305 | None, newest: int) -> None:
        self.session, self.cipher = session, cipher
        self.newest = newest
        # Bit k: counter newest - k was received. The first datagrams, which are greetings, count as
        # received.
        self._seen = (1 << _WINDOW) - 1

    def is_new(self, counter: int) -> bool:
        ahead = counter - self.newest
        if ahead > 0:
            self._seen = (
                ((self._seen << ahead) | 1) & ((1 << _WINDOW) - 1) if ahead < _WINDOW else 1
            )
            self.newest = counter
            return True
        if -ahead >= _WINDOW or self._seen >> -ahead & 1:
            return False
        self._seen |= 1 << -ahead
        return True


def _cipher(key: bytes, role: str, session: bytes) -> ChaCha20Poly1305:
    text = b'aerarm ground_link 2 ' + role.encode() + session
    return ChaCha20Poly1305(hmac.digest(key, text, hashlib.sha256))


def _nonce(counter: int) -> bytes:
    return counter.to_bytes(12, 'little')
