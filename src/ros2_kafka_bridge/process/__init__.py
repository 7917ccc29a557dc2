"""The processes of a bridge: the worker that runs it, and the supervisor above several workers.

Nothing below knows how many there are. The libraries of the command line are not loaded here.
"""
