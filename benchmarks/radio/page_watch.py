"""Measure when the browser page can be used, and how often it is updated.

Usage: python benchmarks/radio/page_watch.py ADDRESS SECONDS

The program prints a JSON object. It contains the times [s] from the start of the browser until the
stop button and the joint states are shown, and the text on the page about the joint states. It also
contains the numbers of poses and curves per second that a separate client of the page receives.
"""

import json
import sys
import tempfile
import time
from pathlib import Path
from urllib.parse import urlsplit

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / 'test' / 'nodes'))

import viser  # noqa: E402
from headless_browser import HeadlessBrowser, until  # noqa: E402
from page_viewer import CAMERA, Viewer  # noqa: E402
from websockets.sync.client import connect  # noqa: E402


def main() -> None:
    """Measure and print."""
    address, seconds = sys.argv[1], float(sys.argv[2])
    found: dict[str, object] = {}
    begin = time.monotonic()
    with tempfile.TemporaryDirectory() as profile:
        browser = HeadlessBrowser(address, Path(profile))
        try:
            until(lambda: 'EMERGENCY STOP' in browser.text())
            found['button'] = time.monotonic() - begin
            until(lambda: 'joint_states at' in browser.text())
            found['states'] = time.monotonic() - begin
            time.sleep(3.0)
            lines = browser.text().splitlines()
            found['says'] = next(line for line in lines if 'joint_states at' in line)
        finally:
            browser.close()
    with connect(
        f'ws://{urlsplit(address).netloc}',
        origin=address,
        subprotocols=[f'viser-v{viser.__version__}'],
        compression=None,
        max_size=None,
    ) as socket:
        viewer = Viewer(socket)
        viewer.send(CAMERA)
        viewer.listen(lambda: viewer.told)
        time.sleep(1.0)
        before = len(viewer.told)
        end = time.monotonic() + seconds
        viewer.listen(lambda: time.monotonic() > end, seconds + 5.0)
        told = viewer.told[before:]
    poses = [m for m in told if m['type'] in ('SetOrientationMessage', 'SetPositionMessage')]
    names = [m.get('name') for m in poses]
    found['poses'] = max((names.count(name) for name in set(names)), default=0) / seconds
    curves = [m for m in told if 'data' in m.get('updates', {})]
    ids = [m.get('uuid') for m in curves]
    found['curves'] = max((ids.count(one) for one in set(ids)), default=0) / seconds
    print(json.dumps(found), flush=True)


if __name__ == '__main__':
    main()
