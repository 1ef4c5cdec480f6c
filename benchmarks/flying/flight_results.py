"""Errors of all flights of a flight campaign, as table and as page with plots and replays."""

import argparse
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from flying.arm_model import ArmModel
from flying.arm_swing import FlightProgram
from flying.flight_case import load_drone
from flying.flight_record import FlightFigures, FlightRecord
from flying.pages import replay, time_plot, write_page

from aerarm_ros.description.drone_config import GRAVITY, DroneConfig
from aerarm_ros.description.robot import load_robot
from aerarm_ros.flight.arm_load import ArmLoadModel, MassProperties
from aerarm_ros.motion.signals import JointReference
from aerarm_ros.pages.html_text import Html, bullets, paragraph, section, table
from aerarm_ros.pages.plots import plotly_figure

COLUMNS = (
    'place RMS [mm]',
    'largest',
    'tilt RMS [deg]',
    'largest',
    'heading, largest [deg]',
    'tool RMS [mm]',
    'largest',
    'time with a rotor at a limit [%]',
)
BASELINE, OBSERVERS, BEST = 'integral', ('observer', 'INDI'), 'posture, motion, lead'
# [mm] largest RMS of the best method, [deg].
GOALS = {
    ('hexarotor', 'slow'): 6.0,
    ('hexarotor', 'fast'): 40.0,
    ('tilted_hexarotor', 'slow'): 4.0,
    ('tilted_hexarotor', 'fast'): 5.0,
}
_TILT_STEP = 0.02  # [s]
_LINE = '{:17} {:24} {:17} {:>8} {:>7} {:>7} {:>6} {:>7} {:>8} {:>7} {:>7}'
_HEADINGS = ('place mm', 'max', 'tilt deg', 'max', 'heading', 'tool mm', 'max', 'limit %')


class FlightResults:
    """Flights of several drones with several feed-forward methods, and their errors.

    Attributes
    ----------
    records : mapping
        Record by drone and method, or the reason of a failure.
    tilt_limits : dict
        Values of `tilt_limit` by drone, for the arm of that URDF.
    figures : dict
        Figures by drone, method and part; None if the drone was lost.
    """

    def __init__(
        self,
        program: FlightProgram,
        records: Mapping[str, Mapping[str, FlightRecord | str]],
        urdf: Path | None = None,
    ) -> None:
        self.program, self.records = program, records
        self.tilt_limits = {name: tilt_limit(load_drone(name), program, urdf) for name in records}
        self.figures: dict[tuple[str, str, str], FlightFigures | None] = {}
        for drone, flights in records.items():
            config = load_drone(drone)
            for way, record in flights.items():
                for part, window in program.windows.items():
                    found = None
                    if not isinstance(record, str):
                        found = record.part(*window).figures(program.motion, config)
                    self.figures[drone, way, part] = found

    def ratio(self, drone: str, part: str, others: tuple[str, ...]) -> float | None:
        """Return the smallest error of `others`, divided by that of full feed-forward."""
        best = self.figures.get((drone, BEST, part))
        found = [self.figures.get((drone, way, part)) for way in others]
        places = [figures.place for figures in found if figures is not None]
        return min(places) / best.place if best and places else None

    def text(self) -> str:
        """Return the table of errors, with the improvement by full feed-forward."""
        lines = [_LINE.format('drone', 'method', 'motion', *_HEADINGS)]
        lost = ['lost', *['-'] * (len(COLUMNS) - 1)]
        for (drone, way, part), figures in self.figures.items():
            shown = lost if figures is None else [f'{x:.2f}' for x in figures]
            lines.append(_LINE.format(drone, way, part, *shown))
        for drone, flights in self.records.items():
            reasons = {way: text for way, text in flights.items() if isinstance(text, str)}
            lines += [f'{drone}, {way}: {text}' for way, text in reasons.items()]
            lines += [f'{drone}, {", ".join(row)}' for row in self.ratios(drone)]
        return '\n'.join(lines)

    def ratios(self, drone: str) -> list[tuple[str, ...]]:
        """Return for each part the improvement by full feed-forward, and its limit."""
        rows = []
        for part in list(self.program.windows)[1:]:
            over = [self.ratio(drone, part, ways) for ways in ((BASELINE,), OBSERVERS)]
            shown = ['-' if value is None else f'{value:.1f}' for value in over]
            row = (
                part,
                f'{shown[0]} = error with integral / error with full feed-forward',
                f'{shown[1]} = error with observer or INDI / error with full feed-forward',
            )
            limit = self.tilt_limits[drone].get(part)
            rows.append(
                row if limit is None else (*row, f'error caused by the tilt alone {limit:.1f} mm')
            )
        return rows


def tilt_limit(
    drone: DroneConfig, program: FlightProgram, urdf: Path | None = None
) -> dict[str, float]:
    """Return, for each part, the RMS body displacement [mm] at constant centre of mass.

    Against a lateral force f such a drone tilts by f / (m g), and its body, at a height h above the
    common centre of mass, moves by h f / (m g). A drone with lateral thrust needs no tilt.

    Parameters
    ----------
    urdf : Path, optional
        URDF of the arm, by default the nominal one.
    """
    if drone.is_fully_actuated:
        return {}
    loads = ArmLoadModel(load_robot(urdf, gravity_in_base=drone.gravity_in_base))

    def off(motion: JointReference) -> float:
        load = loads.evaluate(motion)
        body = MassProperties.of(drone, load.mass, load.com, load.inertia)
        sideways = (drone.mount.rotation @ load.motion[:3])[:2]
        return float(body.centre[2] * np.linalg.norm(sideways) / (body.mass * GRAVITY))

    found = {}
    for part, (begin, end) in program.windows.items():
        if begin >= 0.0:
            rows = zip(*program.motion.evaluate(np.arange(begin, end, _TILT_STEP)), strict=True)
            values = np.array([off(JointReference(*row)) for row in rows])
            found[part] = 1e3 * float(np.sqrt((values**2).mean()))
    return found


Records = dict[str, FlightRecord | str]


def report(
    options: argparse.Namespace, records: dict[str, Records], arm: ArmModel, by: str, name: str
) -> None:
    """Print the table of the flights and, if a folder is given, write the page."""
    results = FlightResults(FlightProgram(parts=options.parts), records, arm.law.get('urdf'))
    note = f'Drones of 3 kg with an arm of 1.5 kg (model {arm.name}){by}'
    print(f'{note}\n{results.text()}')
    if options.out:
        title = 'Hover error caused by arm motion'
        write_page(options.out / name, title, flight_page(results, note))


def flight_page(results: FlightResults, note: str) -> list[str]:
    """Return the sections of the page of a flight campaign.

    Parameters
    ----------
    results
        Results of all flights.
    note
        Description of the settings.
    """
    body = [paragraph(note, 'lead')]
    for drone, flights in results.records.items():
        flown = {way: x for way, x in flights.items() if isinstance(x, FlightRecord)}
        goals = [
            f'{part}: goal at most {limit:g} mm RMS'
            for (name, part), limit in GOALS.items()
            if name == drone
        ]
        ratios = [_without_missing(row) for row in results.ratios(drone)]
        body.append(section(f'{drone}: improvement by "{BEST}"', bullets(ratios + goals)))
        body.append(section(f'{drone}: figures', _table(results, drone)))
        places = {way: 1e3 * np.linalg.norm(x.places, axis=1) for way, x in flown.items()}
        tilts = {way: np.degrees(x.tilts) for way, x in flown.items()}
        body.append(
            section(
                f'{drone}: over time',
                _plot(results, drone, flown, places, 'distance from its set point [mm]'),
                _plot(results, drone, flown, tilts, 'tilt [deg]'),
            )
        )
        shown = {way: flown[way] for way in (BASELINE, BEST) if way in flown}
        if shown:
            drawn = plotly_figure(replay(shown, load_drone(drone)))
            text = (
                'Position errors and tilts of the drones are drawn ten times as large as they are.'
            )
            body.append(section(f'{drone}: replay', paragraph(text, 'note'), drawn))
    return body


def _without_missing(row: tuple[str, ...]) -> str:
    """Return a row without entries for flights that were not made."""
    return ', '.join(text for text in row if not text.startswith('-'))


def _table(results: FlightResults, drone: str) -> Html:
    rows = []
    for (name, way, part), figures in results.figures.items():
        if name == drone:
            rows.append((part, way, *(figures or [None] * len(COLUMNS))))
    order = list(results.program.windows)
    rows.sort(key=lambda row: order.index(row[0]))
    best = [k for k, row in enumerate(rows) if row[1] == BEST]
    return table(('motion', 'method', *COLUMNS), rows, best)


def _plot(
    results: FlightResults,
    drone: str,
    flown: dict[str, FlightRecord],
    values: dict[str, np.ndarray],
    title: str,
) -> Html:
    shapes, texts = [], []
    for part, (begin, end) in results.program.windows.items():
        shapes.append(
            {
                'type': 'rect', 'yref': 'paper', 'x0': begin, 'x1': end, 'y0': 0, 'y1': 1,
                'line': {'width': 0}, 'fillcolor': 'rgba(128,128,128,0.15)',
            }
        )  # fmt: skip
        texts.append(
            {
                'text': part, 'x': 0.5 * (begin + end), 'y': 1.0, 'yref': 'paper',
                'yanchor': 'bottom', 'showarrow': False,
            }
        )  # fmt: skip
    identifier = f'{drone.replace("_", "-")}-{title.split()[0]}'
    marked = {'shapes': shapes, 'annotations': texts}
    return time_plot(identifier, flown, values, title, is_log='mm' in title, **marked)
