"""Datagrams that are encrypted and authenticated with a shared key.

ChaCha20-Poly1305 (RFC 8439) of the library `cryptography` seals each datagram. The key of a session
is derived from the shared key and a random number of its process. So no counter is used twice with
one key. A datagram contains the session number of its receiver, so the receiver rejects recorded
datagrams after its restart. There is no forward secrecy: anyone with the shared key can read
recorded datagrams.
"""

from __future__ import annotations

import hashlib
import hmac
import os
import secrets
import struct
from pathlib import Path

from cryptography.exceptions import InvalidTag
from cryptography.hazmat.primitives.ciphers.aead import ChaCha20Poly1305

KEY_SIZE = 32
"""Bytes of the shared key."""
SESSION_SIZE = 8
NO_SESSION = bytes(SESSION_SIZE)
"""Receiver's session in a datagram before the other end's session is known."""
OVERHEAD = SESSION_SIZE + 8 + SESSION_SIZE + 16
"""Bytes that sealing adds to a body."""

_HEADER = struct.Struct(f'<{SESSION_SIZE}sQ')
_WINDOW = 128  # datagrams that may overtake each other
_KNOWN_MAX = 8  # sessions whose keys are stored


class KeyFileError(ValueError):
    """The key file cannot be used; the message states the recovery hint."""


def make_key(path: Path) -> None:
    """Write a new shared key that only its owner can read.

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
    """Return the shared key of a file.

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


class Session:
    """Seal this end's datagrams and open the other end's.

    Parameters
    ----------
    key
        Shared key.
    role
        Role of this end, which must differ from the other end's. So a datagram that is reflected
        to its sender is rejected.

    Attributes
    ----------
    own : bytes
        Number of this end's session.
    """

    def __init__(self, key: bytes, role: str) -> None:
        self._key = key
        self._role = role
        self._others: dict[bytes, _Other] = {}
        self.renew()

    def renew(self) -> None:
        """Begin a new session of this end, as a restart does."""
        self.own = secrets.token_bytes(SESSION_SIZE)
        self._counter = 0
        self._cipher = _cipher(self._key, self._role, self.own)

    def seal(self, to: bytes, body: bytes) -> bytes:
        """Return a datagram to a session of the other end, or to `NO_SESSION` if unknown."""
        self._counter += 1
        header = _HEADER.pack(self.own, self._counter)
        return header + self._cipher.encrypt(_nonce(self._counter), to + body, header)

    def open(self, datagram: bytes, other_role: str) -> tuple[bytes, bytes, bytes] | None:
        """Return sender's session, addressed session and body; None if it is not authentic.

        The result is also None for a repeated datagram, or one that is far behind others of its
        session.
        """
        if len(datagram) < OVERHEAD:
            return None
        header = datagram[: _HEADER.size]
        session, counter = _HEADER.unpack(header)
        other = self._others.get(session) or _Other(_cipher(self._key, other_role, session))
        try:
            plain = other.cipher.decrypt(_nonce(counter), datagram[_HEADER.size :], header)
        except InvalidTag:
            return None
        if session not in self._others:
            while len(self._others) >= _KNOWN_MAX:
                del self._others[next(iter(self._others))]
            self._others[session] = other
        if not other.is_new(counter):
            return None
        return session, plain[:SESSION_SIZE], plain[SESSION_SIZE:]


class _Other:
    """A session of the other end: its cipher, and the received counters."""

    def __init__(self, cipher: ChaCha20Poly1305) -> None:
        self.cipher = cipher
        self._newest = 0
        self._seen = 0  # bit k: counter newest - k was received

    def is_new(self, counter: int) -> bool:
        ahead = counter - self._newest
        if ahead > 0:
            self._seen = (
                ((self._seen << ahead) | 1) & ((1 << _WINDOW) - 1) if ahead < _WINDOW else 1
            )
            self._newest = counter
            return True
        if -ahead >= _WINDOW or self._seen >> -ahead & 1:
            return False
        self._seen |= 1 << -ahead
        return True


def _cipher(key: bytes, role: str, session: bytes) -> ChaCha20Poly1305:
    text = b'aerarm ground_link 1 ' + role.encode() + session
    return ChaCha20Poly1305(hmac.digest(key, text, hashlib.sha256))


def _nonce(counter: int) -> bytes:
    return counter.to_bytes(12, 'little')
