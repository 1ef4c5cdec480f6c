"""Periodic loop, scheduling, memory locking, timing statistics."""
