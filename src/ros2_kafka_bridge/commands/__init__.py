"""The commands, a folder each, or a file: `cli` is its part of the command line.

That is loaded for every `--help`, the rest of a folder when its command runs. Commands look, and
change nothing but what they are asked to: they write the files that are named, and
`dead-letters replay` sends again.
"""
