"""What the page wears beside what viser gives it: a title, and a layout for a phone."""

from __future__ import annotations

import gzip
from functools import lru_cache

from websockets.http11 import Response

# As wide as viser calls a phone (its breakpoint xs).
_PHONE = '36em'
# Elements without a name of their own are found by the mode that they hold: P is the panel, C the
# list of its elements, M the mode; the emergency stop comes after M.
_P = '.mantine-Paper-root:has(.arm-mode)'
_C = 'div:has(> div > div > .arm-mode)'
_M = 'div:has(> div > .arm-mode)'
# Stop and mode stay on top, however far the panel is scrolled. On a phone the panel would lie over
# the arm's right half: there it has the upper half of the screen, and the arm the lower one.
_STYLE = f"""
.arm-mode {{ font-size: 1.6em; font-weight: bold; }}
{_M} + div button {{ height: 2.8em !important; font-weight: bold; }}
.mantine-ScrollArea-content div:has(.arm-mode) {{ overflow: clip !important; }}
{_C} {{ display: flex; flex-direction: column; }}
{_M} {{ order: -1; position: sticky; top: 3.2em; z-index: 20;
        background: var(--mantine-color-body); box-shadow: 0 -1em var(--mantine-color-body); }}
{_M} + div {{ order: -2; position: sticky; top: 0; z-index: 21;
              background: var(--mantine-color-body); }}
@media (max-width: {_PHONE}) {{
  {_P} {{
    top: 0; left: 0; bottom: auto !important; width: 100% !important;
    max-height: 58dvh !important; overflow-y: auto !important;
  }}
  {_P} div:has(.arm-mode) {{
    width: 100% !important; max-height: none !important; height: auto !important;
    overflow: visible !important;
  }}
  #root > div > div:has(canvas) {{
    position: fixed !important; bottom: 0; height: 42dvh !important; width: 100%;
  }}
}}
"""
_SCRIPT = """
setInterval(() => {
  const mode = document.querySelector('.arm-mode');
  if (mode && document.title !== mode.dataset.title) document.title = mode.dataset.title;
  // A plot that got its data before its width has no numbers along its time axis.
  for (const {chart} of Object.values(window.__viserTestpoints?.uplots ?? {}))
    if (!chart.axes[0]._splits?.length) chart.redraw(false, true);
}, 300);
"""
_DRESS = f'<style>{_STYLE}</style><script>{_SCRIPT}</script></head>'.encode()


def dress(response: Response) -> None:
    """Add title and layout to a page that is served, in place; leave anything else alone."""
    if not response.headers.get('Content-Type', '').startswith('text/html'):
        return
    packed = response.headers.get('Content-Encoding') == 'gzip'
    response.body = _dressed(bytes(response.body), packed)
    del response.headers['Content-Length']
    response.headers['Content-Length'] = str(len(response.body))


@lru_cache(maxsize=4)
def _dressed(page: bytes, packed: bool) -> bytes:
    plain = gzip.decompress(page) if packed else page
    plain = plain.replace(b'<title>Viser</title>', b'<title>aerarm</title>', 1)
    plain = plain.replace(b'</head>', _DRESS, 1)
    return gzip.compress(plain) if packed else plain
