"""Who is served the page: nobody from another site, and nobody without its address."""

from __future__ import annotations

import hmac
import secrets
import socket
from collections.abc import Iterable, Sequence
from ipaddress import ip_address
from urllib.parse import urlsplit

_WILDCARDS = ('', '0.0.0.0', '::')
_LOOPBACK = ('localhost', '127.0.0.1', '::1')


class PageGuard:
    """Judges requests before anything is answered.

    A browser lets every site open connections to every address, the loopback one included, and
    tells in `Origin` which site it is: only the page itself may. A site whose name its owner has
    led to this computer (DNS rebinding) is its own origin, but its name is in `Host`: only
    names of this computer may be there. On a network a token, the first part of the path, is
    asked for as well.

    Parameters
    ----------
    host
        Name or address at which the page is served, or that of all interfaces.
    token
        What the path begins with; none is asked for if empty.
    """

    def __init__(self, host: str, token: str = '') -> None:
        self._names = {name.lower() for name in (*_LOOPBACK, *_own_names(host))}
        self._any_address = host in _WILDCARDS
        self._token = token.encode()

    @classmethod
    def for_host(cls, host: str) -> PageGuard:
        """Return a guard with a new token, unless only this computer can reach the page."""
        return cls(host, '' if is_loopback(host) else secrets.token_urlsafe(24))

    def refusal(
        self, path: str, hosts: Sequence[str], origins: Sequence[str], socket_wanted: bool
    ) -> str:
        """Return why a request is refused, '' if it may be answered.

        Parameters
        ----------
        path
            Its path, with query.
        hosts, origins
            All its headers of these names.
        socket_wanted
            Whether it asks for a websocket; browsers then tell the origin, always.
        """
        if len(hosts) != 1 or not self._is_own(hosts[0]):
            return f'{_shown(hosts)} is no name of this computer: use the address it prints'
        if len(origins) > 1 or (socket_wanted and not origins):
            return f'the origin is {_shown(origins)}, not the page'
        if origins and origins[0].lower() != f'http://{hosts[0]}'.lower():
            return f'the origin is {_shown(origins)}, another site'
        given, _ = _split(path)
        if self._token and not hmac.compare_digest(given.encode(errors='replace'), self._token):
            return 'the address lacks the token: use the one that was printed at the start'
        return ''

    def inner_path(self, path: str) -> str:
        """Return a path without its token."""
        return _split(path)[1] if self._token else path

    def address(self, host: str, port: int) -> str:
        """Return what to open in a browser."""
        name = socket.gethostname() if host in _WILDCARDS else host
        shown = f'[{name}]' if ':' in name else name
        return f'http://{shown}:{port}' + (f'/{self._token.decode()}/' if self._token else '')

    def _is_own(self, host: str) -> bool:
        try:
            parts = urlsplit(f'//{host}')
            name, _ = parts.hostname, parts.port
        except ValueError:
            return False
        if name is None or parts.username is not None or parts.path or parts.query:
            return False
        if name in self._names:
            return True
        # Whoever asks for a number is led astray by no name.
        return self._any_address and _is_number(name)


def is_loopback(host: str) -> bool:
    """Tell whether only this computer reaches what is served there."""
    return host.lower() == 'localhost' or (_is_number(host) and ip_address(host).is_loopback)


def _own_names(host: str) -> Iterable[str]:
    if host not in _WILDCARDS:
        return [host]
    name = socket.gethostname()
    return [name, f'{name}.local', socket.getfqdn()]


def _is_number(host: str) -> bool:
    try:
        ip_address(host)
    except ValueError:
        return False
    return True


def _split(path: str) -> tuple[str, str]:
    """Return the first part of a path and, from its slash on, the rest."""
    plain, question, query = path.partition('?')
    first, _, rest = plain.removeprefix('/').partition('/')
    return first, f'/{rest}{question}{query}'


def _shown(headers: Sequence[str]) -> str:
    """Return headers for people, short and without control characters."""
    return repr(', '.join(headers)[:80]) if headers else 'not told'
