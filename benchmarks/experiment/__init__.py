"""The experiment of the paper (section VII), repeated and widened: see `__main__`."""
