"""Excitation trajectories: Fourier series, feasibility, design."""
