"""The processes of a bridge: the worker that runs it, and the supervisor above several workers.

No room below starts a process of the bridge. The libraries of the command line are not loaded.
"""
