"""What one route is made of and holds while it runs: its flight, counters, labels, its format.

Everything of a route but its ends and its way: nothing here imports `kafka`, `ros` or `spool`.
"""
