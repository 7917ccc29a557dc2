"""Who runs a route, and when: its runner in a running bridge, and the term that a lock gives it.

How it fares is its life, what it has counted over all its terms its totals.

No pipeline imports it: a term is a stop to them as any other.
"""
