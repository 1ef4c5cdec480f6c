from aerarm_ros.ros.page.view_diagnostics import ViewDiagnostics, ViewStatus


def test_a_silent_publisher_turns_stale() -> None:
    diagnostics = ViewDiagnostics()
    diagnostics.add('arm', ViewStatus(0, 'ready', received=10.0))
    assert 'OK' in diagnostics.status_html(12.0)
    assert 'STALE' in diagnostics.status_html(14.0)


def test_a_level_that_does_not_exist_is_an_error() -> None:
    diagnostics = ViewDiagnostics()
    diagnostics.add('other', ViewStatus(7, 'strange', received=1.0))
    assert 'ERROR' in diagnostics.status_html(1.0)
    assert diagnostics.recovery_hint(1.0) == ''


def test_text_from_the_graph_is_escaped() -> None:
    diagnostics = ViewDiagnostics()
    status = ViewStatus(
        1, '<img src=x onerror=alert(1)>', {'<b> winding [degC]': '<i>'}, received=1.0
    )
    diagnostics.add('<script>', status)
    for html in (diagnostics.status_html(1.0), diagnostics.motors_html(1.0)):
        assert '<script>' not in html
        assert '<img' not in html
        assert '<i>' not in html


def test_statuses_of_ended_nodes_are_removed() -> None:
    diagnostics = ViewDiagnostics()
    diagnostics.add('recorder', ViewStatus(0, 'in order', received=1.0))
    diagnostics.add('arm', ViewStatus(0, 'ready', received=12.0))
    html = diagnostics.status_html(12.0)
    assert ('recorder' in html, 'ready' in html) == (False, True)
    for second in range(100):
        diagnostics.add(f'node{second}', ViewStatus(0, '', received=13.0 + second))
    assert len(diagnostics._statuses) <= 11


def test_the_recovery_hint_is_that_of_a_running_bridge() -> None:
    diagnostics = ViewDiagnostics()
    assert diagnostics.recovery_hint(0.0) == ''
    values = {'recovery hint': "'arm clear_fault'"}
    diagnostics.add('arm', ViewStatus(2, 'fault', values, received=10.0))
    assert diagnostics.recovery_hint(11.0) == "'arm clear_fault'"
    assert diagnostics.recovery_hint(20.0) == ''


def test_temperatures_and_the_time_that_is_left_make_a_table():
    diagnostics = ViewDiagnostics()
    values = {
        'joint2 winding [degC]': '85.1',
        'joint2 housing [degC]': '44.0',
        'joint2 torque limit [Nm]': '9.39',
        'joint2 time to reduction [s]': '17',
    }
    diagnostics.add('bridge: motors', ViewStatus(1, 'warm', values, received=10.0))
    diagnostics.add('other', ViewStatus(0, 'ok', {}, received=10.0))
    html = diagnostics.motors_html(10.0)
    for text in ('joint2', '85.1', '44.0', '9.39', '17', 'reduced in', 'WARN'):
        assert text in html
    assert 'other' not in html
