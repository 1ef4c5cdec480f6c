"""Page with plots and replays of a flight campaign."""

import argparse

import numpy as np
from flying.arm_model import ArmModel
from flying.flight_program import FlightProgram
from flying.flight_record import FlightRecord
from flying.flight_replay import replay
from flying.flight_results import BASELINE, BEST, COLUMNS, GOALS, FlightResults
from flying.flight_way import load_drone
from flying.pages import time_plot, write_page

from aerarm_ros.pages.html_text import Html, bullets, paragraph, section, table
from aerarm_ros.pages.plots import plotly_figure

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
