"""Frames, boards, safety gate and the bridge cycle."""
