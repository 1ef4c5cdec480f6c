import socket

import pytest

from aerarm_ros.ros.page.page_server import PageGuard, is_loopback


def refusal(
    guard: PageGuard, host: str | None, origin: str | None = None, path: str = '/', ws: bool = False
) -> str:
    return guard.refusal(path, [host] if host else [], [origin] if origin else [], ws)


@pytest.mark.parametrize('host', ['127.0.0.1:8080', 'localhost:9000', '[::1]:8080', 'LOCALHOST'])
def test_requests_of_the_page_itself_are_accepted(host: str) -> None:
    guard = PageGuard('127.0.0.1')
    assert refusal(guard, host) == ''
    assert refusal(guard, host, f'http://{host}', ws=True) == ''


@pytest.mark.parametrize(
    'host',
    [
        'evil.example:8080',
        'localhost.evil.example:8080',
        '127.0.0.1.evil.example',
        '127.0.0.1@evil.example',
        'evil.example@127.0.0.1:8080',
        '127.0.0.1:8080/evil',
        '192.168.1.2:8080',
        '127.0.0.1:port',
        '[::1',
        '',
        ' ',
        None,
    ],
)
def test_a_name_that_is_not_this_computer_is_refused(host: str | None) -> None:
    assert 'not a name of this computer' in refusal(PageGuard('127.0.0.1'), host)


@pytest.mark.parametrize(
    'origin',
    [
        'http://evil.example',
        'http://127.0.0.1:9999',
        'http://localhost:8080',
        'https://127.0.0.1:8080',
        'http://127.0.0.1:8080.evil.example',
        'http://127.0.0.1:8080/',
        'null',
        'file://',
    ],
)
@pytest.mark.parametrize('ws', [False, True])
def test_another_site_is_refused(origin: str, ws: bool) -> None:
    assert 'other web site' in refusal(PageGuard('127.0.0.1'), '127.0.0.1:8080', origin, ws=ws)


def test_a_websocket_needs_an_origin() -> None:
    assert 'an empty value' in refusal(PageGuard('127.0.0.1'), '127.0.0.1:8080', ws=True)


def test_a_header_that_comes_twice_is_refused() -> None:
    guard, host = PageGuard('127.0.0.1'), '127.0.0.1:8080'
    assert guard.refusal('/', [host, 'evil.example'], [], False)
    assert guard.refusal('/', [host], [f'http://{host}', 'http://evil.example'], True)


def test_on_a_network_the_token_is_required() -> None:
    guard = PageGuard('0.0.0.0', 'secret')
    host = '192.168.1.2:8080'
    for path in ('/', '/secre/', '/secret1/', '/SECRET/', '/?secret', '//secret/', '/x/secret/'):
        assert 'token' in refusal(guard, host, path=path), path
        assert 'token' in refusal(guard, host, f'http://{host}', path, ws=True)
    for path in ('/secret', '/secret/', '/secret/?darkMode', '/secret?x'):
        assert refusal(guard, host, path=path) == ''
    assert guard.inner_path('/secret') == '/'
    assert guard.inner_path('/secret/a/b?c=/d') == '/a/b?c=/d'


@pytest.mark.parametrize(
    'host', ['192.168.1.2', '[fe80::1]:8080', socket.gethostname(), 'localhost']
)
def test_a_page_for_all_goes_by_every_name_of_this_computer(host: str) -> None:
    assert refusal(PageGuard('0.0.0.0'), host) == ''
    assert refusal(PageGuard('0.0.0.0'), 'evil.example')


def test_tokens_are_new_each_time_and_only_where_they_are_needed() -> None:
    addresses = {PageGuard.for_host('0.0.0.0').address('pi', 80) for _ in range(5)}
    assert len(addresses) == 5
    assert min(map(len, addresses)) >= len('http://pi:80//') + 32
    assert PageGuard.for_host('::1').address('::1', 80) == 'http://[::1]:80'


@pytest.mark.parametrize(
    ('host', 'loopback'),
    [('127.0.0.1', True), ('127.1.2.3', True), ('localhost', True), ('::1', True)]
    + [('0.0.0.0', False), ('::', False), ('', False), ('192.168.1.2', False), ('pi', False)],
)
def test_loopback_addresses_are_recognized(host: str, loopback: bool) -> None:
    assert is_loopback(host) is loopback
