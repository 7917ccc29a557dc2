"""Measurements: each prints its table, and needs nothing but this repository."""
