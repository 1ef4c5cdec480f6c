"""Diagnostics of all nodes, as HTML for the page."""

from aerarm_ros.ros.page.view_diagnostics import ViewDiagnostics


def test_silent_publishers_turn_stale_and_ended_ones_are_removed() -> None:
    diagnostics = ViewDiagnostics()
    assert diagnostics.recovery_hint(0.0) == ''
    diagnostics.add('arm', 2, 'fault', {'recovery hint': "'arm clear_fault'"}, 10.0)
    assert ('ERROR' in diagnostics.status_html(12.0), diagnostics.recovery_hint(12.0)) == (
        True,
        "'arm clear_fault'",
    )
    assert ('STALE' in diagnostics.status_html(14.0), diagnostics.recovery_hint(14.0)) == (True, '')
    diagnostics.add('recorder', 0, 'in order', {}, 21.0)
    html = diagnostics.status_html(21.0)
    assert ('recorder' in html, 'fault' in html) == (True, False)
    for second in range(100):
        diagnostics.add(f'node{second}', 0, '', {}, 22.0 + second)
    assert len(diagnostics._statuses) <= 11


def test_text_from_the_graph_is_escaped_and_any_level_is_shown() -> None:
    diagnostics = ViewDiagnostics()
    values = {'<b> winding [degC]': '<i>'}
    diagnostics.add('<script>', 7, '<img src=x onerror=alert(1)>', values, 1.0)
    for html in (diagnostics.status_html(1.0), diagnostics.motors_html(1.0)):
        assert not any(tag in html for tag in ('<script>', '<img', '<i>'))
        assert 'ERROR' in html


def test_temperatures_and_the_time_that_is_left_make_a_table() -> None:
    diagnostics = ViewDiagnostics()
    values = {
        'joint2 winding [degC]': '85.1',
        'joint2 housing [degC]': '44.0',
        'joint2 torque limit [Nm]': '9.39',
        'joint2 time to reduction [s]': '17',
    }
    diagnostics.add('bridge: motors', 1, 'warm', values, 10.0)
    diagnostics.add('other', 0, 'ok', {}, 10.0)
    html = diagnostics.motors_html(10.0)
    for text in ('joint2', '85.1', '44.0', '9.39', '17', 'reduced in', 'WARN'):
        assert text in html
    assert 'other' not in html
