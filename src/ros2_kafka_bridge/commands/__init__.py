"""The commands, a folder each: `cli` is its part of the command line, loaded for every `--help`.

The rest of a folder is loaded when the command runs. All but `run` and `demo` look, and change
nothing but what they are asked to: `init` writes a file, `dead-letters replay` sends again.
"""
