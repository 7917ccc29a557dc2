"""One route in a running bridge: it runs, again after a failure; how it fares, what it counts.

Nothing here knows of other bridges: what an exclusive route waits for is a wrapper around this.
"""
