"""Title and phone layout, put into the page that viser serves."""

import gzip
from importlib.util import find_spec

import pytest

MISSING = find_spec('viser') is None
pytestmark = pytest.mark.skipif(MISSING, reason="viser is not installed: 'aerarm_ros[view]'")
if not MISSING:
    from websockets import Headers
    from websockets.http11 import Response

    from aerarm_ros.ros.page.page_server import dress

PAGE = b'<html><head><title>Viser</title></head><body></body></html>'


@pytest.mark.parametrize('encoding', ['identity', 'gzip'])
def test_title_and_layout_are_added_to_a_page_with_the_right_length(encoding: str) -> None:
    body = gzip.compress(PAGE) if encoding == 'gzip' else PAGE
    headers = {'Content-Type': 'text/html; charset=utf-8', 'Content-Encoding': encoding}
    response = Response(200, 'OK', Headers(**headers, **{'Content-Length': str(len(body))}), body)
    dress(response)
    assert response.headers.get_all('Content-Length') == [str(len(response.body))]
    plain = gzip.decompress(response.body) if encoding == 'gzip' else bytes(response.body)
    assert b'<title>aerarm</title>' in plain
    assert b'document.title' in plain
    assert plain.count(b'</head>') == 1


def test_anything_else_is_left_alone() -> None:
    body = b'</head>'
    response = Response(200, 'OK', Headers(**{'Content-Type': 'text/css'}), body)
    dress(response)
    assert response.body == body
