"""Who runs a route, and when: again after a failure, by a lock, for a term.

Above the directions, which know only that a stop was asked for.
"""
