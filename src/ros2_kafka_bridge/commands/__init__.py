"""The commands: each a folder whose `cli` is its part of the command line, or that part alone.

That is loaded for every `--help`, the rest when the command runs. All but `run` and `demo` look,
and change nothing but what they are asked to: they write files that are named, and `dead-letters
replay` sends again.
"""
