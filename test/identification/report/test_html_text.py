"""Everything from outside is escaped."""

from aerarm_ros.identification.report.html_text import Html, bullets, number, page, section, table

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


def test_long_names_in_headings_may_break() -> None:
    assert 'shoulder_<wbr>pan_<wbr>joint [%]' in table(['shoulder_pan_joint [%]'], [[1.0]])
    assert '<wbr>' not in table(['a'], [['left_arm']])
