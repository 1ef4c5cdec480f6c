"""The report is one file that opens offline and says what matters."""

import re
import subprocess
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
from headless_browser import CHROMIUM

from aerarm_ros.identification.identification_result import IdentificationResult
from aerarm_ros.identification.recording.recording import BagFacts
from aerarm_ros.identification.report import ReportExtras, friction_figure, report_html
from aerarm_ros.identification.report_tables import parameter_table
from aerarm_ros.identification.truth import Truth, inertial_torque_errors

VOID = {'meta', 'link', 'br', 'img', 'hr', 'input', 'wbr'}


class Page(HTMLParser):
    """Checks nesting, and collects references, headings and texts outside scripts."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.stack: list[str] = []
        self.references: list[str] = []
        self.headings: list[str] = []
        self.texts: list[str] = []
        self.feed(text)
        self.close()

    def handle_starttag(self, tag: str, attrs: list) -> None:
        self.references += [v for k, v in attrs if k in ('src', 'href', 'action', 'data')]
        if tag not in VOID:
            self.stack.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.stack.pop() == tag

    def handle_data(self, data: str) -> None:
        if self.stack and self.stack[-1] == 'h2':
            self.headings.append(data)
        elif self.stack and self.stack[-1] not in ('script', 'style'):
            self.texts.append(data)


@pytest.fixture(scope='module')
def extras(result: IdentificationResult, arm) -> ReportExtras:
    model = result.fit.model
    values = np.concatenate([arm.inertial.ravel(), arm.viscous, arm.coulomb, arm.rotor])
    truth = Truth(dict(zip(model.columns, values, strict=True)), np.zeros(4), np.ones(4))
    estimates = [solution.estimate for solution in result.solutions.values()]
    return ReportExtras(
        truth,
        inertial_torque_errors(truth, estimates, result.validation),
        facts={'bag1': BagFacts('1.0 .. 25.0 s of 26.0 s (motion)', 3, None)},
    )


@pytest.fixture(scope='module')
def html(result: IdentificationResult, extras: ReportExtras) -> str:
    return report_html(result, extras)


def test_the_report_contains_tables_and_figures(html: str, result: IdentificationResult) -> None:
    page = Page(html)
    assert not page.stack
    # It needs no network: to places of its own.
    assert all(reference.startswith('#s') for reference in page.references)
    assert len(html) < 3e6
    assert page.headings == [
        *('Torque errors', 'Torque errors per joint', 'Comparison with the true parameters'),
        'bag1 (identification): measured and predicted torque',
        'bag1 (identification): residual over time',
        'bag2 (validation): measured and predicted torque',
        'bag2 (validation): residual over time',
        *('Parameters', 'Base parameters', 'Friction', 'Conditioning and excitation'),
    ]
    # Two of each bag, and friction.
    assert html.count('Plotly.newPlot(') == 5
    text = ' '.join(page.texts)
    sdp, cad = (result.solutions[name].validation[0].filtered for name in ('sdp', 'cad_friction'))
    assert f'of the identified model on bag2 (validation): {sdp:.2f} % filtered' in text
    assert f'{cad:.2f} % with the CAD model and identified friction ({cad / sdp:.1f} times' in text
    assert '1.0 .. 25.0 s of 26.0 s (motion)' in page.texts
    assert {*result.fit.model.columns, *result.used_base.expressions()} <= {*page.texts}


def test_friction_curves_have_the_data_behind_them(result: IdentificationResult) -> None:
    traces = friction_figure(result).traces
    model = result.recommended.estimate
    for joint in range(4):
        cloud, curve, _ = (t for t in traces if t['yaxis'] == f'y{joint + 1 if joint else ""}')
        speed = curve['x0'] + curve['dx'] * np.arange(len(curve['y']))
        fs, fv = (model.joint_values(symbol)[joint] for symbol in ('fs', 'fv'))
        assert curve['y'][-1] == pytest.approx(fs + fv * speed[-1], rel=1e-3)
        dq, torque = np.array(cloud['x']), np.array(cloud['y'])
        fast = np.abs(dq) > 0.3 * speed[-1]
        off = torque - (fs * np.sign(dq) + fv * dq)
        assert np.sqrt(np.mean(off[fast] ** 2)) < 0.3 * fs


def test_missing_true_values_are_a_dash(result: IdentificationResult, extras: ReportExtras) -> None:
    known = {k: v for k, v in extras.truth.parameters.items() if k != 'fv_joint1'}
    for truth, dashes in ((extras.truth, 0), (replace(extras.truth, parameters=known), 1)):
        rows = parameter_table(result, truth).split('<tr>')
        (row,) = (row for row in rows if '>fv_joint1<' in row)
        assert row.count('–') == dashes


@pytest.mark.skipif(CHROMIUM is None, reason='chromium is not installed: apt install chromium')
def test_a_real_browser_draws_every_figure(html: str, tmp_path: Path) -> None:
    page = tmp_path / 'report.html'
    # What the browser says about errors and requests goes into the page it prints.
    watch = (
        '<script>window.onerror = m => document.documentElement.dataset.error = m;'
        'new PerformanceObserver(l => document.documentElement.dataset.fetched ='
        'l.getEntries().map(e => e.name).join()).observe({type: "resource"});</script>'
    )
    page.write_text(html.replace('<head>', '<head>' + watch))
    options = ['--headless', '--no-sandbox', '--disable-gpu', '--virtual-time-budget=10000']
    options += [f'--user-data-dir={tmp_path / "profile"}', '--dump-dom', page.as_uri()]
    done = subprocess.run([str(CHROMIUM), *options], capture_output=True, text=True, timeout=120)
    root, body = done.stdout.split('<head>', 1)[0], done.stdout.rsplit('<body>', 1)[1]
    assert 'data-error' not in root
    assert 'data-fetched' not in root
    # A bag has three curves of torque and one of its residual; friction has two. Each is drawn for
    # four joints and in the legend.
    assert len(re.findall(r'class="js-line"', body)) == 5 * (2 * (3 + 1) + 2)
    assert all(f'{joint} [Nm]' in body for joint in ('joint1', 'joint4'))
