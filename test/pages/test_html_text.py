"""Everything from outside is escaped."""

import re
from html import unescape

from aerarm_ros.pages.html_text import Html, bullets, number, origin, page, section, table

NASTY = '<script>alert("x")</script>&'


def test_texts_are_escaped_everywhere() -> None:
    parts = [
        table([NASTY], [[NASTY, 1.0]]),
        section(NASTY, NASTY),
        bullets([NASTY]),
        page(NASTY, '', []),
    ]
    for part in parts:
        assert '<script>' not in part
        assert '&lt;script&gt;' in part


def test_html_is_not_escaped_twice() -> None:
    assert '<b>bold</b>' in section('title', Html('<b>bold</b>'))


def test_numbers_are_short_and_missing_ones_a_dash() -> None:
    assert number(1234.5678) == '1235'
    assert number(1.23456e-7) == '1.235e-07'
    assert number(None) == number(float('nan')) == number(float('inf')) == '–'


def test_the_points_of_a_column_of_numbers_lie_below_each_other() -> None:
    cells = re.findall(
        '<td>([^<]*)</td>', table(['a', 'b'], [['x', 1.25], ['y', 12.0], ['z', 1e9]])
    )
    assert cells == ['1.25', '12\N{PUNCTUATION SPACE}' + 2 * '\N{FIGURE SPACE}', '1e+09']


def test_a_page_states_its_command_version_and_contents() -> None:
    body = [section(f'part {k} {NASTY}', 'text') for k in range(5)]
    made = origin(['/opt/bin/identifier', '--bag', 'a b'])
    html = page('title', '', body, made)
    assert made['command'] == "identifier --bag 'a b'"
    assert made['by'].startswith('aerarm_ros ')
    for value in made.values():
        assert value in unescape(html)
    links = re.findall('href="#(.*?)"', html)
    assert links == re.findall('<h2 id="(.*?)">', html)
    assert len(links) == 5
    assert '<nav>' not in page('title', '', body[:3])
    assert '<script>' not in html
