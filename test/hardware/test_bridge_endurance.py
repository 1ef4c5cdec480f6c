"""A long run is like a short one; `benchmarks/real_time/bridge.py` does 100,000 cycles."""

import gc
import resource
import sys

import numpy as np

OMEGA = 2 * np.pi * 0.5
SWING = np.array([0.5, 0.1, 0.5, 0.5])


def swing(now):
    return None, SWING * np.sin(OMEGA * now), None


def footprint():
    gc.collect()
    return sys.getallocatedblocks(), resource.getrusage(resource.RUSAGE_SELF).ru_maxrss


def test_twenty_thousand_cycles_are_like_a_thousand(rig):
    # A publisher that is rejected now and then, to count as well.
    def run(seconds):
        for _ in range(round(seconds)):
            rig.run(0.5, swing)
            rig.send(velocity=[0.0] * 4, source='other')
            rig.run(0.5, swing)

    run(1)
    blocks, peak = footprint()
    tracking = np.abs(rig.bridge.dq - swing(rig.now)[1]).max()
    run(20)
    more_blocks, more_peak = footprint()
    assert more_blocks - blocks < 200
    assert more_peak - peak < 2048  # [KiB]
    assert rig.bridge.mode == 'running', rig.bridge.faults
    assert np.abs(rig.bridge.dq - swing(rig.now)[1]).max() < 2.0 * tracking + 0.1
    assert rig.bridge.counters['board0 bad frames'] == 0
    assert rig.bridge.intake.rejections == {'source': 21}
