"""The figures of all attacks on the bridge, and every byte of the frames, for `same.py`."""

import argparse
import hashlib
import json
from pathlib import Path

# All modules of the suite and its tests that this script needs.
import attack_campaign
import attack_zeros
from attack_rig import AttackRig

ATTACKS = attack_campaign.ATTACKS
NUMBER = 1  # of the arm and the random source
RESTARTS = 4  # every so many attacks, one is repeated with a bridge that restarts
_WINDOW = 200  # exchanges per digest


class KeptRig(AttackRig):
    """A rig that can be inspected after an attack."""

    newest: 'KeptRig'

    def __init__(self, *arguments: object, **options: object) -> None:
        super().__init__(*arguments, **options)
        KeptRig.newest = self


def digest(data: bytes) -> str:
    """Return a short hash."""
    return hashlib.sha256(data).hexdigest()[:12]


def wire(rig: AttackRig) -> dict[str, object]:
    """Return digests of the exchanges with all boards, and of the true motion."""
    rows = [
        f'{time!r} {board} '.encode() + sent + got for time, board, sent, got in rig.frames.rows
    ]
    windows = range(0, len(rows), _WINDOW)
    return {
        'frames': len(rows),
        'digests of the frames': [digest(b''.join(rows[i : i + _WINDOW])) for i in windows],
        'digest of the true motion': digest(rig.log.q.tobytes() + rig.log.dq.tobytes()),
    }


def attacks() -> dict[str, object]:
    """Run each attack once."""
    attack_campaign.AttackRig = KeptRig
    items: dict[str, object] = {}
    for name in ATTACKS:
        outcome = vars(attack_campaign.run(name, NUMBER))
        items[f'attacks/{name}'] = {'figures': outcome, 'wire': wire(KeptRig.newest)}
    return items


def zeros() -> dict[str, object]:
    """Run attacks on an arm that was never homed, and on bridges that restart."""
    attack_zeros.AttackRig = KeptRig
    items: dict[str, object] = {}
    for index, name in enumerate(ATTACKS):
        kinds = {'unknown zeros': attack_zeros.attack_unknown}
        if index % RESTARTS == 0:
            kinds['restart'] = attack_zeros.attack_restart
        for kind, attack in kinds.items():
            outcome = vars(attack(name, NUMBER))
            items[f'attacks/{kind}/{name}'] = {'figures': outcome, 'wire': wire(KeptRig.newest)}
    return items


def main() -> None:
    """Write the items of one part."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('part', choices=('attacks', 'zeros'))
    parser.add_argument('--out', type=Path, required=True)
    parser.add_argument('--work', type=Path, required=True)
    options = parser.parse_args()
    items = attacks() if options.part == 'attacks' else zeros()
    options.out.write_text(json.dumps(items))


if __name__ == '__main__':
    main()
